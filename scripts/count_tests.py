"""count_tests.py TESTLOG RESULT: adds up the test cases of a meson test log.

Counts the cases inside a test program where its output tells them (cmocka, Python's unittest, or a
line `N passed, N failed` of its own), else the program as one. A program that failed without a
failed case (it crashed, hung or was killed) is one failure more. Prints the sum as the last line;
exits 1 if anything failed, if RESULT (meson's exit code) is not 0, or if nothing was run.
"""
import json
import re
import sys

CMOCKA = re.compile(r"^\[ *(PASSED|FAILED|SKIPPED) *\] (\d+) test\(s\)", re.M)
CMOCKA_OK = re.compile(r"^\[ *OK *\] ", re.M)
UNITTEST_RAN = re.compile(r"^Ran (\d+) tests? in", re.M)
UNITTEST_BAD = re.compile(r"(failures|errors|skipped)=(\d+)")
OWN = re.compile(r"^(\d+) passed, (\d+) failed(?:, (\d+) skipped)?$", re.M)


def count_cases(text):
    """(passed, failed, skipped) as the program's own output has them; None where it has none."""
    cmocka = CMOCKA.findall(text)
    if cmocka:
        total = {"PASSED": 0, "FAILED": 0, "SKIPPED": 0}
        for word, number in cmocka:
            total[word] += int(number)
        return total["PASSED"], total["FAILED"], total["SKIPPED"]
    if CMOCKA_OK.search(text):  # it ended before its summary
        return len(CMOCKA_OK.findall(text)), 0, 0
    ran = UNITTEST_RAN.search(text)
    if ran:
        bad = {"failures": 0, "errors": 0, "skipped": 0}
        for word, number in UNITTEST_BAD.findall(text[ran.end():]):
            bad[word] += int(number)
        failed = bad["failures"] + bad["errors"]
        return int(ran.group(1)) - failed - bad["skipped"], failed, bad["skipped"]
    own = OWN.findall(text)
    if own:
        return tuple(int(number or 0) for number in own[-1])
    return None


def count_program(test):
    text = (test.get("stdout") or "") + "\n" + (test.get("stderr") or "")
    ended_well = test["result"] in ("OK", "SKIP")
    cases = count_cases(text)
    if cases is None:
        if test["result"] == "SKIP":
            return 0, 0, 1
        return (1, 0, 0) if ended_well else (0, 1, 0)
    passed, failed, skipped = cases
    if not ended_well and failed == 0:
        failed = 1
    return passed, failed, skipped


def main():
    path, result = sys.argv[1], int(sys.argv[2])
    sums = [0, 0, 0]
    failed_programs = []
    try:
        with open(path, encoding="utf-8", errors="replace") as log:
            for line in log:
                test = json.loads(line)
                counts = count_program(test)
                sums = [a + b for a, b in zip(sums, counts)]
                if counts[1]:
                    failed_programs.append(test["name"])
    except FileNotFoundError:
        print("no test has run")
    passed, failed, skipped = sums
    if (result != 0 or passed == 0) and failed == 0:
        failed = 1
    for name in failed_programs:
        print("failed:", name)
    print(f"{passed} passed, {failed} failed" + (f", {skipped} skipped" if skipped else ""))
    sys.exit(1 if failed else 0)


main()
