/*
 * The table of all options: what the parser reads and what help prints.
 */
#ifndef SPBM_TOOLS_OPTION_TABLE_H
#define SPBM_TOOLS_OPTION_TABLE_H

#include <stddef.h>

enum option_id {
    OPTION_OUTPUT,
    OPTION_WELD,
    OPTION_FACES,
    OPTION_RATIO,
    OPTION_ERROR,
    OPTION_MODE,
    OPTION_EFFORT,
    OPTION_PATCH_ANGLE,
    OPTION_FACE_ANGLE,
    OPTION_SMOOTH,
    OPTION_CHAIN_TOLERANCE,
    OPTION_PLACE,
    OPTION_FORMAT,
    OPTION_KEEP,
    OPTION_RESUME,
    OPTION_DRY_RUN,
    OPTION_CACHE,
    OPTION_SAMPLES,
    OPTION_SELF_INTERSECTIONS,
    OPTION_ERROR_PLY,
    OPTION_SIZE,
    OPTION_VIEW,
    OPTION_UP,
    OPTION_WIREFRAME,
    OPTION_SHADING,
    OPTION_LEGEND,
    OPTION_NO_CAPTIONS,
    OPTION_BACKGROUND,
    OPTION_MAX_FEATURE,
    OPTION_FEATURE_SIZE,
    OPTION_SHARP_ANGLE,
    OPTION_REMOVE_PIPES,
    OPTION_KEEP_PIPES,
    OPTION_DROP_COMPONENTS,
    OPTION_CLOSE_CRACKS,
    OPTION_CRACK_SIZE,
    OPTION_SMOOTH_FEATURES,
    OPTION_ZIP_TOLERANCE,
    OPTION_MERGE_COPLANAR,
    OPTION_MEMORY,
    OPTION_THREADS,
    OPTION_TMP,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_VERBOSE,
    OPTION_HELP,
    OPTION_VERSION
};

struct option_row {
    enum option_id id;
    unsigned group;
    char letter;          /* 0: none */
    const char *name;     /* without the dashes */
    const char *argument; /* NULL: takes none */
    const char *help;     /* lines; the default at the end */
};

extern const struct option_row option_rows[];
extern const size_t option_row_count;

#endif
