/*
 * The memory limit of control groups is read from trees as version 1, version 2 and both at once
 * make them: the strictest on the way up counts, and what can't be read is no limit.
 */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tools/limits.h"
#include "test_files.h"

enum { MOST_FILES = 6 };

struct tree {
    const char *what;
    const char *groups; /* /proc/self/cgroup; NULL: there is none */
    struct {
        const char *name, *content; /* below /sys/fs/cgroup; content NULL: a folder */
    } files[MOST_FILES];
    uint64_t limit;
};

#define NO_LIMIT_V1 "9223372036854771712\n"

static const struct tree trees[] = {
    {"no groups", NULL, {{0}}, UINT64_MAX},
    {"v2", "0::/job\n", {{"job/memory.max", "104857600\n"}}, 104857600},
    {"v2 without a limit",
     "0::/job\n",
     {{"job/memory.max", "max\n"}, {"job/memory.high", "max\n"}},
     UINT64_MAX},
    {"v2, memory.high is lower",
     "0::/job\n",
     {{"job/memory.max", "2000000\n"}, {"job/memory.high", "1500000\n"}},
     1500000},
    {"v2, memory.max is lower",
     "0::/job\n",
     {{"job/memory.max", "1000000\n"}, {"job/memory.high", "1500000\n"}},
     1000000},
    {"v2, the group above is stricter",
     "0::/user.slice/job/step\n",
     {{"user.slice/memory.max", "max\n"},
      {"user.slice/job/memory.max", "3000000\n"},
      {"user.slice/job/step/memory.max", "8000000\n"}},
     3000000},
    {"v2, the topmost is strictest, by memory.high",
     "0::/user.slice/job/step\n",
     {{"user.slice/memory.high", "700000\n"},
      {"user.slice/job/memory.max", "3000000\n"},
      {"user.slice/job/step/memory.max", "max\n"}},
     700000},
    {"v2 in a container: its own group is the root",
     "0::/\n",
     {{"memory.max", "5000000\n"}},
     5000000},
    {"v2, the path is not visible, its root is",
     "0::/docker/0123\n",
     {{"memory.max", "6000000\n"}},
     6000000},
    {"v2, a group of another name",
     "0::/job\n",
     {{"jobs/memory.max", "1000\n"}, {"job/memory.max", "9000000\n"}},
     9000000},
    {"v1",
     "5:cpu,cpuacct:/c\n4:memory:/job\n1:name=systemd:/s\n",
     {{"memory/job/memory.limit_in_bytes", "400000\n"}},
     400000},
    {"v1 without a limit: a number like any other",
     "4:memory:/job\n",
     {{"memory/job/memory.limit_in_bytes", NO_LIMIT_V1}},
     UINT64_C(9223372036854771712)},
    {"v1, nested",
     "4:memory:/job/step\n",
     {{"memory/memory.limit_in_bytes", NO_LIMIT_V1},
      {"memory/job/memory.limit_in_bytes", "300000\n"},
      {"memory/job/step/memory.limit_in_bytes", NO_LIMIT_V1}},
     300000},
    {"v1, mounted with another controller",
     "4:hugetlb,memory:/job\n",
     {{"memory/job/memory.limit_in_bytes", "250000\n"}},
     250000},
    {"v1, other controllers",
     "4:memory2:/job\n5:cpu:/job\n",
     {{"memory/job/memory.limit_in_bytes", "250000\n"}},
     UINT64_MAX},
    {"hybrid: v1 has the memory",
     "4:memory:/job\n0::/unified\n",
     {{"memory/job/memory.limit_in_bytes", "350000\n"}, {"unified/cgroup.procs", "1\n"}},
     350000},
    {"hybrid: both have limits",
     "4:memory:/job\n0::/job\n",
     {{"memory/job/memory.limit_in_bytes", "350000\n"}, {"job/memory.max", "340000\n"}},
     340000},
    {"not a file", "0::/job\n", {{"job/memory.max", NULL}}, UINT64_MAX},
    {"not a number",
     "0::/job\n",
     {{"job/memory.max", "lots\n"}, {"job/memory.high", ""}, {"memory.max", "123456\n"}},
     123456},
    {"lines that are none", "\n4\n4:memory\n::\n0::\n", {{0}}, UINT64_MAX},
};

/* Makes the folders on the way to the file. */
static void make_folders(const char *path)
{
    char folder[TEST_PATH];
    for (const char *slash = strchr(path + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        snprintf(folder, sizeof folder, "%.*s", (int)(slash - path), path);
        mkdir(folder, 0700);
    }
}

static void put(const char *root, const char *below, const char *name, const char *content)
{
    char path[2 * TEST_PATH];
    snprintf(path, sizeof path, "%s/%s/%s", root, below, name);
    make_folders(path);
    if (content)
        file_write(path, content, strlen(content));
    else
        assert_int_equal(mkdir(path, 0700), 0);
}

static void trees_are_read(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof trees / sizeof *trees; i++) {
        const struct tree *tree = &trees[i];
        char root[TEST_PATH], command[2 * TEST_PATH];
        folder_make(root);
        if (tree->groups)
            put(root, "proc/self", "cgroup", tree->groups);
        for (int f = 0; f < MOST_FILES && tree->files[f].name; f++)
            put(root, "sys/fs/cgroup", tree->files[f].name, tree->files[f].content);
        const uint64_t limit = limits_of_groups(root);
        if (limit != tree->limit)
            fail_msg("%s: %llu", tree->what, (unsigned long long)limit);
        snprintf(command, sizeof command, "rm -r '%s'", root);
        assert_int_equal(system(command), 0);
    }
}

/* A file that the user may not read. Root may, so that there is nothing to see then. */
static void what_is_not_readable_is_no_limit(void **state)
{
    (void)state;
    char root[TEST_PATH], path[2 * TEST_PATH], command[2 * TEST_PATH];
    folder_make(root);
    put(root, "proc/self", "cgroup", "0::/job\n");
    put(root, "sys/fs/cgroup", "job/memory.max", "1000\n");
    put(root, "sys/fs/cgroup", "memory.max", "2000\n");
    snprintf(path, sizeof path, "%s/sys/fs/cgroup/job/memory.max", root);
    assert_int_equal(chmod(path, 0), 0);
    assert_int_equal(limits_of_groups(root), geteuid() == 0 ? 1000 : 2000);
    snprintf(command, sizeof command, "rm -r '%s'", root);
    assert_int_equal(system(command), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(trees_are_read),
        cmocka_unit_test(what_is_not_readable_is_no_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
