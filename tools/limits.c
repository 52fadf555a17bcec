/*
 * The naive default, all memory and all processors of the machine, gets a batch job killed: it may
 * have a part of both only. The control group's limit is that of the strictest group on the way up
 * from ours; version 2 tells it in memory.max, version 1 in memory.limit_in_bytes (where no limit
 * is a huge number, which the minimum takes care of).
 */
#include "limits.h"

#include <limits.h>
#include <sched.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/sysinfo.h>
#include <unistd.h>

static void lower(uint64_t *limit, const char **from, uint64_t value, const char *words)
{
    if (value > 0 && value < *limit) {
        *limit = value;
        *from = words;
    }
}

/* A file that holds one number; UINT64_MAX when it holds none ("max") or is not there. */
static uint64_t read_limit(const char *path)
{
    unsigned long long value;
    FILE *file = fopen(path, "re");
    if (!file)
        return UINT64_MAX;
    int got = fscanf(file, "%llu", &value);
    fclose(file);
    return got == 1 ? value : UINT64_MAX;
}

/* The strictest limit of the group `path` in the hierarchy mounted at root/mount, and of those
 * above it. */
static uint64_t group_limit(const char *root, const char *mount, const char *path, const char *name)
{
    char group[PATH_MAX], file[3 * PATH_MAX];
    uint64_t least = UINT64_MAX;
    snprintf(group, sizeof group, "%s", strcmp(path, "/") == 0 ? "" : path);
    for (;;) {
        const int length = snprintf(file, sizeof file, "%s%s%s/%s", root, mount, group, name);
        const uint64_t value =
            length > 0 && (size_t)length < sizeof file ? read_limit(file) : UINT64_MAX;
        if (value < least)
            least = value;
        char *slash = strrchr(group, '/');
        if (!slash)
            return least;
        *slash = '\0';
    }
}

/* Whether the list "cpu,cpuacct" has this name. */
static bool has_name(const char *list, const char *name)
{
    const size_t length = strlen(name);
    for (;;) {
        const size_t part = strcspn(list, ",");
        if (part == length && memcmp(list, name, length) == 0)
            return true;
        if (list[part] == '\0')
            return false;
        list += part + 1;
    }
}

/* What the line "number:controllers:path" of /proc/self/cgroup leads to. Version 2 has no
 * controllers there; in a hybrid system its groups don't limit memory, and have no such files. */
static uint64_t limit_of_line(const char *root, char *line)
{
    line[strcspn(line, "\n")] = '\0';
    char *controllers = strchr(line, ':');
    char *path = controllers ? strchr(controllers + 1, ':') : NULL;
    if (!path)
        return UINT64_MAX;
    *path++ = '\0';
    controllers++;
    if (*controllers == '\0') {
        const uint64_t most = group_limit(root, "/sys/fs/cgroup", path, "memory.max");
        const uint64_t high = group_limit(root, "/sys/fs/cgroup", path, "memory.high");
        return high < most ? high : most; /* above it the group is slowed down */
    }
    if (has_name(controllers, "memory"))
        return group_limit(root, "/sys/fs/cgroup/memory", path, "memory.limit_in_bytes");
    return UINT64_MAX;
}

uint64_t limits_of_groups(const char *root)
{
    char name[2 * PATH_MAX], line[PATH_MAX + 128];
    uint64_t least = UINT64_MAX;
    snprintf(name, sizeof name, "%s/proc/self/cgroup", root);
    FILE *file = fopen(name, "re");
    while (file && fgets(line, sizeof line, file)) {
        const uint64_t value = limit_of_line(root, line);
        if (value < least)
            least = value;
    }
    if (file)
        fclose(file);
    return least;
}

/* The number at the front of an environment variable (OMP_NUM_THREADS may be a list); 0 if none. */
static uint64_t from_environment(const char *name)
{
    const char *text = getenv(name);
    if (!text || *text < '0' || *text > '9')
        return 0;
    return strtoull(text, NULL, 10);
}

static void find_memory(struct limits *limits)
{
    struct sysinfo info;
    uint64_t memory = UINT64_MAX;
    limits->memory_from = "no limit is known";
    if (sysinfo(&info) == 0)
        lower(&memory, &limits->memory_from, (uint64_t)info.totalram * info.mem_unit,
              "half of the machine's memory");
    lower(&memory, &limits->memory_from, limits_of_groups(""),
          "half of the control group's memory");
    uint64_t megabytes = from_environment("SLURM_MEM_PER_NODE");
    if (megabytes < UINT64_MAX >> 20)
        lower(&memory, &limits->memory_from, megabytes << 20, "half of SLURM_MEM_PER_NODE");
    limits->memory = memory / 2;
}

static void find_threads(struct limits *limits)
{
    uint64_t threads = UINT64_MAX;
    cpu_set_t set;
    limits->threads_from = "the machine's processors";
    if (sched_getaffinity(0, sizeof set, &set) == 0) {
        lower(&threads, &limits->threads_from, (uint64_t)CPU_COUNT(&set),
              "the processors this process may use");
    } else {
        long online = sysconf(_SC_NPROCESSORS_ONLN);
        lower(&threads, &limits->threads_from, online > 0 ? (uint64_t)online : 1,
              "the machine's processors");
    }
    lower(&threads, &limits->threads_from, from_environment("SLURM_CPUS_PER_TASK"),
          "SLURM_CPUS_PER_TASK");
    lower(&threads, &limits->threads_from, from_environment("OMP_NUM_THREADS"), "OMP_NUM_THREADS");
    limits->threads = threads > 1024 ? 1024 : (unsigned)threads;
}

void limits_find(struct limits *limits)
{
    find_memory(limits);
    find_threads(limits);
}
