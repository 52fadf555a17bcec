/* Numbers in text: against strtod in the C locale, and the float32 rule against printf. */
#include "mesh/parse_number.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <stdlib.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static struct parsed_number parse_all(const char *text)
{
    struct parsed_number number;
    /* An exact-size copy, so that a look behind the end is found by the sanitizer. */
    size_t length = strlen(text);
    unsigned char *tight = malloc(length ? length : 1);
    assert_non_null(tight);
    memcpy(tight, text, length);
    const unsigned char *stop = parse_real(tight, tight + length, &number);
    if (stop != tight + length)
        print_error("\"%s\" was not parsed to its end\n", text);
    assert_ptr_equal(stop, tight + length);
    free(tight);
    /* Numbers that are not the last thing in the text may be parsed in another way. */
    static const char more[] = " 12345678.12345678 9012345678901234567890";
    struct parsed_number inside;
    unsigned char *copy = malloc(length + sizeof more);
    assert_non_null(copy);
    memcpy(copy, text, length);
    memcpy(copy + length, more, sizeof more);
    assert_ptr_equal(parse_real(copy, copy + length + sizeof more, &inside), copy + length);
    assert_memory_equal(&inside.value, &number.value, sizeof number.value);
    assert_int_equal(inside.fits_float32, number.fits_float32);
    assert_int_equal(inside.is_integer, number.is_integer);
    free(copy);
    return number;
}

static void assert_same_as_strtod(const char *text)
{
    struct parsed_number number = parse_all(text);
    double expected = strtod(text, NULL);
    if (memcmp(&number.value, &expected, sizeof expected) != 0)
        print_error("\"%s\" gave %.17g, not %.17g\n", text, number.value, expected);
    assert_memory_equal(&number.value, &expected, sizeof expected);
}

static void corner_cases_are_rounded_correctly(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "0",
        "-0",
        "+0",
        "0.0",
        "-0.0e5",
        "0e-400",
        "1",
        "-1",
        "+1",
        "1.",
        ".5",
        "-.5",
        "007",
        "1e0",
        "1E5",
        "1e+5",
        "1e-5",
        "1.e2",
        "123456789",
        "1234567890123456789",
        "12345678901234567890",
        "99999999999999999999999",
        "9007199254740993",
        "9007199254740992",
        "9007199254740993.0000000000000000000001",
        "9007199254740992.9999999999999999999",
        "1e22",
        "1e23",
        "-1e23",
        "8.5e22",
        "1e37",
        "1e63",
        "1e64",
        "1e65",
        "1e308",
        "1.8e308",
        "1e400",
        "1e99999999999",
        "1e-99999999999",
        "2.2250738585072014e-308",
        "2.2250738585072011e-308",
        "5e-324",
        "2e-324",
        "4.9406564584124654e-324",
        "0.1000000000000000055511151231257827",
        "0.10000000000000000555111512312578270211815834045",
        "0.000000000000000000000000000000000000000000000000000000000000000001",
        "0000000000000000000000000000.5",
        "0.00000000000000000000000000000123456789012345678",
        "1.2725200000000001",
        "12.995900000000001",
        "0.2613417263194",
        "500123.456",
        "179769313486231570000000000000000000000",
        "3.4028234663852886e38",
        "0.500000000000000166533453693773481063544750213623046875",
        "1.00000000000000011102230246251565404236316680908203125",
        "1.00000000000000011102230246251565404236316680908203124",
        "1.00000000000000011102230246251565404236316680908203126",
        "7205759403792793199999e-5",
        "7205759403792793200001e-5",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        assert_same_as_strtod(texts[i]);
}

static void random_texts_are_rounded_correctly(void **state)
{
    (void)state;
    uint64_t seed = 1;
    char text[64];
    for (int i = 0; i < 400000; i++) {
        uint64_t bits = random_next(&seed);
        double value;
        switch (i % 6) {
        case 0: /* any double, in 1 to 20 digits */
            memcpy(&value, &bits, sizeof value);
            if (!isfinite(value))
                continue;
            snprintf(text, sizeof text, "%.*e", (int)random_below(&seed, 20), value);
            break;
        case 1: /* sizes of coordinates */
            value = (random_unit(&seed) - 0.5) * (double)(1u << random_below(&seed, 24));
            snprintf(text, sizeof text, "%.*g", 1 + (int)random_below(&seed, 19), value);
            break;
        case 2:
            snprintf(text, sizeof text, "%.*f", (int)random_below(&seed, 18),
                     random_unit(&seed) * 1000);
            break;
        case 3: /* all digits by chance */
            snprintf(text, sizeof text, "%llu.%llue%d", (unsigned long long)(bits >> 32),
                     (unsigned long long)(bits & 0xffffffff), (int)random_below(&seed, 150) - 75);
            break;
        case 4:
            snprintf(text, sizeof text, "%llue%d", (unsigned long long)bits,
                     (int)random_below(&seed, 140) - 70);
            break;
        default: { /* on or beside a tie: the middle of two neighbouring doubles */
            uint64_t odd = (bits >> 10 | 1ull << 53) | 1;
            int shift = (int)random_below(&seed, 10);
            unsigned __int128 wide = (unsigned __int128)odd << shift;
            int beside = (int)random_below(&seed, 3) - 1;
            wide += (unsigned __int128)beside;
            uint64_t high = (uint64_t)(wide / 1000000000), low = (uint64_t)(wide % 1000000000);
            snprintf(text, sizeof text, "%llu%09llu", (unsigned long long)high,
                     (unsigned long long)low);
        }
        }
        assert_same_as_strtod(text);
    }
}

static void printed_doubles_come_back(void **state)
{
    (void)state;
    uint64_t seed = 2;
    char text[64];
    for (int i = 0; i < 300000; i++) {
        double value = (random_unit(&seed) - 0.5) * (i % 2 ? 1 : 1e7);
        snprintf(text, sizeof text, "%.17g", value);
        assert_true(parse_all(text).value == value);
        float single = (float)value;
        snprintf(text, sizeof text, "%.9g", (double)single);
        struct parsed_number number = parse_all(text);
        assert_true((float)number.value == single);
        assert_true(number.fits_float32);
    }
}

/* The rule as it is said: the float printed with as many decimals as the text has is the text. */
static void float_rule_is_the_printed_text(void **state)
{
    (void)state;
    uint64_t seed = 3;
    char text[64], again[64];
    size_t fitting = 0, total = 0;
    for (int i = 0; i < 200000; i++) {
        int decimals = (int)random_below(&seed, 12);
        double scale = i % 3 == 0 ? 1 : i % 3 == 1 ? 100 : 1e6;
        snprintf(text, sizeof text, "%.*f", decimals, (random_unit(&seed) - 0.5) * scale);
        struct parsed_number number = parse_all(text);
        snprintf(again, sizeof again, "%.*f", decimals, (double)(float)number.value);
        /* A float that lies in the middle of two texts is enough for both of them. */
        double half = 0.5 * pow(10, -decimals),
               off = fabs((double)(float)number.value - number.value);
        if (fabs(off - half) > 1e-9 * half + 1e-15 * fabs(number.value))
            assert_int_equal(number.fits_float32, strcmp(text, again) == 0);
        else
            assert_true(number.fits_float32);
        fitting += number.fits_float32;
        total++;
    }
    assert_true(fitting > total / 5 && fitting < total * 4 / 5);
    assert_true(parse_all("500123.4").fits_float32);
    assert_true(parse_all("500123.5").fits_float32);
    assert_false(parse_all("500123.456").fits_float32);
    assert_false(parse_all("16777217").fits_float32);
    assert_true(parse_all("16777216").fits_float32);
    assert_false(parse_all("1e39").fits_float32);
    assert_true(parse_all("1e30").fits_float32);
    assert_true(parse_all("0.1").fits_float32);
    assert_false(parse_all("0.100000000000").fits_float32);
    assert_true(parse_all("0.10000000149").fits_float32);
    assert_true(parse_all("1.98113e-010").fits_float32);
    assert_true(parse_all("1e-60").fits_float32 == false);
}

static void what_is_no_number_is_refused(void **state)
{
    (void)state;
    static const char *const texts[] = {"",  "-",   "+",  ".",   "-.",  "e5", "1e", "1e+",
                                        "x", "--1", " 1", "-e1", ".e1", "in", "na", "#IND"};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        struct parsed_number number;
        const unsigned char *at = (const unsigned char *)texts[i];
        assert_null(parse_real(at, at + strlen(texts[i]), &number));
    }
    char *longest = malloc(NUMBER_LENGTH_MAX + 2);
    assert_non_null(longest);
    memset(longest, '7', NUMBER_LENGTH_MAX + 1);
    struct parsed_number number;
    const unsigned char *at = (const unsigned char *)longest;
    assert_non_null(parse_real(at, at + NUMBER_LENGTH_MAX, &number));
    assert_null(parse_real(at, at + NUMBER_LENGTH_MAX + 1, &number));
    free(longest);
}

static void parsing_stops_behind_the_number(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        size_t length;
        double value;
    } cases[] = {{"1.5 2", 3, 1.5}, {"1.5e3x", 5, 1500}, {"12,5", 2, 12},   {"1/2", 1, 1},
                 {"0x10", 1, 0},    {"3\n", 1, 3},       {"1.2.3", 3, 1.2}, {"-7-", 2, -7}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct parsed_number number;
        const unsigned char *at = (const unsigned char *)cases[i].text;
        const unsigned char *stop = parse_real(at, at + strlen(cases[i].text), &number);
        assert_ptr_equal(stop, at + cases[i].length);
        assert_true(number.value == cases[i].value);
    }
    /* The end of the buffer ends the number, whatever follows. */
    struct parsed_number number;
    const unsigned char *at = (const unsigned char *)"12345678901234567890";
    for (size_t length = 1; length <= 9; length++) {
        assert_ptr_equal(parse_real(at, at + length, &number), at + length);
        char text[16] = "";
        memcpy(text, at, length);
        assert_true(number.value == strtod(text, NULL));
        assert_true(number.is_integer);
    }
}

static void not_finite_words_are_known(void **state)
{
    (void)state;
    assert_true(isnan(parse_all("nan").value));
    assert_true(isnan(parse_all("-NaN").value));
    assert_true(parse_all("inf").value == (double)INFINITY);
    assert_true(parse_all("-INFINITY").value == -(double)INFINITY);
    assert_false(parse_all("inf").fits_float32);
}

static void integers_are_exact_or_refused(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        int64_t value;
        bool good;
    } cases[] = {{"0", 0, true},
                 {"-1", -1, true},
                 {"+17", 17, true},
                 {"4294967295", 4294967295, true},
                 {"-9000000000000000000", -9000000000000000000, true},
                 {"99999999999999999999", 0, false},
                 {"", 0, false},
                 {"-", 0, false},
                 {"a", 0, false}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int64_t value;
        const unsigned char *at = (const unsigned char *)cases[i].text;
        const unsigned char *stop = parse_integer(at, at + strlen(cases[i].text), &value);
        assert_int_equal(stop != NULL, cases[i].good);
        if (stop)
            assert_true(value == cases[i].value && *stop == 0);
    }
    uint32_t index;
    const unsigned char *at = (const unsigned char *)"4294967295/";
    assert_ptr_equal(parse_index(at, at + 11, &index), at + 10);
    assert_int_equal(index, UINT32_MAX);
    at = (const unsigned char *)"4294967296";
    assert_null(parse_index(at, at + 10, &index));
    at = (const unsigned char *)"99999999999999999999999999";
    assert_null(parse_index(at, at + 26, &index));
}

static void the_locale_does_not_matter(void **state)
{
    (void)state;
    static const char *const names[] = {"de_DE.UTF-8", "fr_FR.UTF-8", "de_DE", "C"};
    for (unsigned i = 0; i < 4; i++)
        if (setlocale(LC_ALL, names[i]))
            break;
    assert_true(parse_all("1.5").value == 1.5);
    assert_true(parse_all("1.0000000000000000000000000000005e-300").value == 1e-300);
    setlocale(LC_ALL, "C");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(corner_cases_are_rounded_correctly),
        cmocka_unit_test(random_texts_are_rounded_correctly),
        cmocka_unit_test(printed_doubles_come_back),
        cmocka_unit_test(float_rule_is_the_printed_text),
        cmocka_unit_test(what_is_no_number_is_refused),
        cmocka_unit_test(parsing_stops_behind_the_number),
        cmocka_unit_test(not_finite_words_are_known),
        cmocka_unit_test(integers_are_exact_or_refused),
        cmocka_unit_test(the_locale_does_not_matter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
