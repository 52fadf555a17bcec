/* Plain stdio for tests, so that what is under test is not used to test itself. */
#include "test_files.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void must(int holds, const char *what)
{
    if (!holds) {
        perror(what);
        abort();
    }
}

const char *folder_path(char path[TEST_PATH], const char *folder, const char *name)
{
    int length = snprintf(path, TEST_PATH, "%s/%s", folder, name);
    must(length > 0 && length < TEST_PATH, "path too long");
    return path;
}

void folder_make(char folder[TEST_PATH])
{
    const char *place = getenv("TMPDIR");
    folder_path(folder, place && *place ? place : "/tmp", "spbm-test-XXXXXX");
    must(mkdtemp(folder) != NULL, folder);
}

static int walk(const char *folder, int remove)
{
    DIR *listing = opendir(folder);
    must(listing != NULL, folder);
    int count = 0;
    for (struct dirent *entry; (entry = readdir(listing));) {
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0)
            continue;
        char path[TEST_PATH];
        count++;
        if (remove)
            unlink(folder_path(path, folder, entry->d_name));
    }
    closedir(listing);
    return count;
}

int folder_count(const char *folder)
{
    return walk(folder, 0);
}

int folder_remove(const char *folder)
{
    int count = walk(folder, 1);
    must(rmdir(folder) == 0, folder);
    return count;
}

void file_write(const char *path, const void *data, size_t size)
{
    FILE *file = fopen(path, "wb");
    must(file != NULL, path);
    must(fwrite(data, 1, size, file) == size, path);
    must(fclose(file) == 0, path);
}

unsigned char *file_read(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (!file)
        return NULL;
    unsigned char *data = NULL;
    size_t have = 0, room = 0;
    do { /* a pipe does not tell how much there will be */
        if (room - have < 2)
            must((data = realloc(data, room = 2 * room + 4096)) != NULL, path);
        have += fread(data + have, 1, room - have - 1, file);
    } while (!feof(file) && !ferror(file));
    must(!ferror(file), path);
    data[have] = 0;
    fclose(file);
    if (size)
        *size = have;
    return data;
}
