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

/* The strictest limit of the group `path` under `root` and of those above it. */
static uint64_t group_limit(const char *root, const char *path, const char *name)
{
    char group[PATH_MAX], file[2 * PATH_MAX];
    uint64_t least = UINT64_MAX;
    snprintf(group, sizeof group, "%s", path);
    for (;;) {
        snprintf(file, sizeof file, "%s%s/%s", root, strcmp(group, "/") == 0 ? "" : group, name);
        uint64_t value = read_limit(file);
        if (value < least)
            least = value;
        char *slash = strrchr(group, '/');
        if (!slash)
            return least;
        *slash = '\0';
    }
}

/* Our own control groups: lines "number:controllers:path". */
static uint64_t control_group_memory(void)
{
    FILE *file = fopen("/proc/self/cgroup", "re");
    char line[PATH_MAX + 128];
    uint64_t least = UINT64_MAX;
    while (file && fgets(line, sizeof line, file)) {
        line[strcspn(line, "\n")] = '\0';
        char *controllers = strchr(line, ':');
        char *path = controllers ? strchr(controllers + 1, ':') : NULL;
        if (!path)
            continue;
        *path++ = '\0';
        controllers++;
        uint64_t value = UINT64_MAX;
        if (*controllers == '\0') {
            uint64_t high = group_limit("/sys/fs/cgroup", path, "memory.high");
            value = group_limit("/sys/fs/cgroup", path, "memory.max");
            value = high < value ? high : value; /* above it the group is slowed down */
        } else if (strcmp(controllers, "memory") == 0) {
            value = group_limit("/sys/fs/cgroup/memory", path, "memory.limit_in_bytes");
        }
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
    lower(&memory, &limits->memory_from, control_group_memory(),
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
