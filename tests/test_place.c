#include "test_place.h"

#include <stdlib.h>

static void count_warning(void *user, enum message_level level, const char *text)
{
    (void)text;
    ((struct place *)user)->warnings += level == MESSAGE_WARNING;
}

int place_set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    if (!place)
        return -1;
    context_init(&place->ctx);
    place->ctx.message = count_warning;
    place->ctx.user = place;
    folder_make(place->folder);
    folder_path(place->path, place->folder, "file");
    *state = place;
    return 0;
}

int place_tear_down(void **state)
{
    struct place *place = *state;
    uint64_t left = place->ctx.memory_now;
    folder_remove(place->folder);
    context_clear(&place->ctx);
    free(place);
    return left == 0 ? 0 : -1;
}
