/*
 * Parsing by table: every option has one row with its letter, name, argument, the group of commands
 * that take it, and its help. getopt_long would do the walking, but neither says which word was
 * meant by a mistyped one nor which command an option belongs to, and it keeps its state in
 * globals.
 */
#include "options.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "option_table.h"
#include "values.h"

struct parser {
    const struct command *command;
    const struct command *commands;
    struct options *options;
    bool has_faces, has_ratio, has_error;
    const char *error_text; /* --error's value: whether it is a bound is known at the end */
    char failure[512];      /* the first one; said at the end, unless help was asked for */
};

static void misuse(struct parser *parser, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

static void misuse(struct parser *parser, const char *format, ...)
{
    if (parser->failure[0])
        return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(parser->failure, sizeof parser->failure, format, arguments);
    va_end(arguments);
}

static void bad_value(struct parser *parser, const char *name, const char *value,
                      const char *expected)
{
    misuse(parser, "--%s %s: not %s", name, value, expected);
}

/* The option's value as one of `words` (NULL-terminated); their index, or -1. */
static int read_word(struct parser *parser, const char *name, const char *value,
                     const char *const *words)
{
    char all[256] = "";
    for (int i = 0; words[i]; i++) {
        if (strcmp(words[i], value) == 0)
            return i;
        size_t used = strlen(all);
        snprintf(all + used, sizeof all - used, "%s%s", i ? ", " : "one of ", words[i]);
    }
    bad_value(parser, name, value, all);
    return -1;
}

/* The values of --faces, --ratio or --error as the levels' targets. */
static void read_targets(struct parser *parser, const char *name, const char *value,
                         spbm_target_kind kind)
{
    spbm_target *target = &parser->options->target;
    size_t count = list_length(value);
    if (count > SPBM_TARGETS_MAX) {
        misuse(parser, "--%s: at most %d levels can be made at once", name, (int)SPBM_TARGETS_MAX);
        return;
    }
    target->kind = kind;
    target->count = (uint32_t)count;
    for (size_t i = 0; i < count; i++) {
        char item[64];
        uint64_t faces = 0;
        bool is_relative = false, is_good = list_item(value, i, item, sizeof item);
        if (is_good && kind == SPBM_BY_FACES) {
            is_good = read_count(item, &faces) && faces > 0;
            target->values[i] = (double)faces;
        } else if (is_good && kind == SPBM_BY_RATIO) {
            is_good = read_ratio(item, &target->values[i]);
        } else if (is_good) {
            is_good = read_length(item, &target->values[i], &is_relative);
            if (i > 0 && is_good && is_relative != (target->error_is_relative != 0)) {
                misuse(parser, "--%s %s: either all values have a %% or none", name, value);
                return;
            }
            target->error_is_relative = is_relative;
        }
        if (!is_good) {
            bad_value(parser, name, value,
                      kind == SPBM_BY_FACES   ? "a number of faces, as 12700 or 12.7k"
                      : kind == SPBM_BY_RATIO ? "a ratio in (0,1] or a percentage, as 0.05 or 5%"
                                              : "an error, as 0.02 or 0.1%");
            return;
        }
    }
}

static void read_angles(struct parser *parser, const char *name, const char *value,
                        double angles[2])
{
    size_t count = list_length(value);
    for (size_t i = 0; i < count; i++) {
        char item[64];
        if (count > 2 || !list_item(value, i, item, sizeof item) ||
            !read_number(item, &angles[i]) || angles[i] > 180) {
            bad_value(parser, name, value, "one or two angles in degrees, as 12 or 12,20");
            return;
        }
    }
}

static void read_direction(struct parser *parser, const char *name, const char *value,
                           double direction[3])
{
    double length = 0;
    for (size_t i = 0; i < 3; i++) {
        char item[64];
        bool is_good = list_length(value) == 3 && list_item(value, i, item, sizeof item);
        bool is_negative = is_good && item[0] == '-';
        if (!is_good || !read_number(item + is_negative, &direction[i])) {
            bad_value(parser, name, value, "a direction, as 1,-2,0.5");
            return;
        }
        if (is_negative)
            direction[i] = -direction[i];
        length += direction[i] * direction[i];
    }
    if (!(length > 0))
        bad_value(parser, name, value, "a direction: its length is 0");
}

static void read_picture_size(struct parser *parser, const char *name, const char *value)
{
    unsigned width, height;
    char rest;
    if (sscanf(value, "%5ux%5u%c", &width, &height, &rest) != 2 || width < 16 || height < 16 ||
        width > 16384 || height > 16384) {
        bad_value(parser, name, value, "a size in pixels from 16x16 to 16384x16384, as 800x600");
        return;
    }
    parser->options->render.width = width;
    parser->options->render.height = height;
}

static uint64_t read_whole(struct parser *parser, const char *name, const char *value, uint64_t low,
                           uint64_t high)
{
    uint64_t number = 0;
    if (!read_count(value, &number) || number < low || number > high)
        misuse(parser, "--%s %s: not a whole number from %llu to %llu", name, value,
               (unsigned long long)low, (unsigned long long)high);
    return number;
}

static void take_format(struct parser *parser, const char *name, const char *value)
{
    static const char *const words[] = {"ply", "ply-ascii", "ply-big", "obj", "stl", "off", NULL};
    static const spbm_format formats[] = {SPBM_FORMAT_PLY,     SPBM_FORMAT_PLY_ASCII,
                                          SPBM_FORMAT_PLY_BIG, SPBM_FORMAT_OBJ,
                                          SPBM_FORMAT_STL,     SPBM_FORMAT_OFF};
    int word = read_word(parser, name, value, words);
    if (word >= 0)
        parser->options->lod.format = formats[word];
}

static void take_mode(struct parser *parser, const char *name, const char *value)
{
    static const char *const words[] = {"collapse", "classic", NULL};
    int word = read_word(parser, name, value, words);
    if (word >= 0)
        parser->options->target.mode = word == 0 ? SPBM_COLLAPSE : SPBM_CLASSIC;
}

static void take_place(struct parser *parser, const char *name, const char *value)
{
    static const char *const words[] = {"subset", "optimal", NULL};
    int word = read_word(parser, name, value, words);
    if (word >= 0)
        parser->options->lod.place = word == 0 ? SPBM_PLACE_SUBSET : SPBM_PLACE_OPTIMAL;
}

static void take_shading(struct parser *parser, const char *name, const char *value)
{
    static const char *const words[] = {"flat", "smooth", NULL};
    int word = read_word(parser, name, value, words);
    if (word >= 0)
        parser->options->render.flat = word == 0;
}

static void take_chain_tolerance(struct parser *parser, const char *name, const char *value)
{
    bool is_relative = false;
    if (!read_length(value, &parser->options->patch.chain_tolerance, &is_relative))
        bad_value(parser, name, value, "a tolerance, as 0.02 or 0.05%");
    parser->options->patch.tolerance_is_relative = is_relative;
}

static void take_length(struct parser *parser, const char *name, const char *value,
                        spbm_length *length)
{
    bool is_relative = false;
    if (!read_length(value, &length->value, &is_relative) || !(length->value > 0))
        bad_value(parser, name, value, "a size above 0, as 0.02 or 3%");
    length->is_relative = is_relative;
}

/* The same, but 0 is one, too. */
static void take_tolerance(struct parser *parser, const char *name, const char *value,
                           spbm_length *length)
{
    bool is_relative = false;
    if (!read_length(value, &length->value, &is_relative))
        bad_value(parser, name, value, "a length, as 0.02 or 0.1%");
    length->is_relative = is_relative;
}

static void take_topology_option(struct parser *parser, const struct option_row *row,
                                 const char *value)
{
    static const char *const measures[] = {"exact", "sampled", "box", "extent", NULL};
    static const char *const cracks[] = {"diameter", "inscribed", NULL};
    spbm_topology_options *topology = &parser->options->topology;
    int word;
    switch (row->id) {
    case OPTION_MAX_FEATURE:
        take_length(parser, row->name, value, &topology->max_feature);
        break;
    case OPTION_FEATURE_SIZE:
        word = read_word(parser, row->name, value, measures);
        topology->size = word >= 0 ? (spbm_loop_size)word : SPBM_SIZE_EXACT;
        break;
    case OPTION_SHARP_ANGLE:
        read_angles(parser, row->name, value, topology->sharp_angle);
        break;
    case OPTION_KEEP_PIPES:
        topology->remove_pipes = 0;
        break;
    case OPTION_REMOVE_PIPES:
        topology->remove_pipes = 1;
        break;
    case OPTION_DROP_COMPONENTS:
        take_length(parser, row->name, value, &topology->drop_components);
        break;
    case OPTION_CLOSE_CRACKS:
        take_length(parser, row->name, value, &topology->close_cracks);
        break;
    case OPTION_CRACK_SIZE:
        topology->crack_inscribed = read_word(parser, row->name, value, cracks) == 1;
        break;
    case OPTION_SMOOTH_FEATURES:
        topology->smooth_features = 1;
        break;
    case OPTION_ZIP_TOLERANCE:
        take_tolerance(parser, row->name, value, &topology->zip_tolerance);
        break;
    case OPTION_MERGE_COPLANAR:
        topology->merge_coplanar = 1;
        break;
    default:
        break;
    }
}

/* Options about the job: shared, measure, render. */
static void take_job_option(struct parser *parser, const struct option_row *row, const char *value)
{
    struct options *options = parser->options;
    switch (row->id) {
    case OPTION_SAMPLES:
        options->measure.samples_per_face =
            (uint32_t)read_whole(parser, row->name, value, 1, 1000000);
        break;
    case OPTION_SELF_INTERSECTIONS:
        options->measure.self_intersections = 1;
        break;
    case OPTION_ERROR_PLY:
        options->measure.error_ply = value;
        break;
    case OPTION_SIZE:
        read_picture_size(parser, row->name, value);
        break;
    case OPTION_VIEW:
        read_direction(parser, row->name, value, options->render.view);
        break;
    case OPTION_UP:
        read_direction(parser, row->name, value, options->render.up);
        break;
    case OPTION_WIREFRAME:
        options->render.wireframe = 1;
        break;
    case OPTION_SHADING:
        take_shading(parser, row->name, value);
        break;
    case OPTION_LEGEND:
        options->render.legend = value;
        break;
    case OPTION_NO_CAPTIONS:
        options->render.captions = 0;
        break;
    case OPTION_BACKGROUND:
        if (!read_colour(value, &options->render.background))
            bad_value(parser, row->name, value, "a colour, as ffffff");
        break;
    case OPTION_MEMORY:
        if (!read_size(value, &options->memory))
            bad_value(parser, row->name, value, "a size, as 512M or 2G");
        break;
    case OPTION_THREADS:
        options->threads = (unsigned)read_whole(parser, row->name, value, 1, 1024);
        break;
    case OPTION_TMP:
        options->tmp_dir = value;
        break;
    case OPTION_JSON:
        options->json = value;
        break;
    case OPTION_QUIET:
        options->quiet = true;
        break;
    case OPTION_VERBOSE:
        options->verbose = true;
        break;
    default:
        break;
    }
}

static void take_option(struct parser *parser, const struct option_row *row, const char *value)
{
    struct options *options = parser->options;
    switch (row->id) {
    case OPTION_OUTPUT:
        options->output = value;
        break;
    case OPTION_WELD:
        options->weld = true;
        break;
    case OPTION_FACES:
        parser->has_faces = true;
        read_targets(parser, row->name, value, SPBM_BY_FACES);
        break;
    case OPTION_RATIO:
        parser->has_ratio = true;
        read_targets(parser, row->name, value, SPBM_BY_RATIO);
        break;
    case OPTION_ERROR:
        parser->has_error = true;
        parser->error_text = value;
        break;
    case OPTION_MODE:
        take_mode(parser, row->name, value);
        break;
    case OPTION_EFFORT:
        options->target.effort = (uint32_t)read_whole(parser, row->name, value, 1, 3);
        break;
    case OPTION_PATCH_ANGLE:
        read_angles(parser, row->name, value, options->patch.patch_angle);
        break;
    case OPTION_FACE_ANGLE:
        read_angles(parser, row->name, value, options->patch.face_angle);
        break;
    case OPTION_SMOOTH:
        options->patch.smoothings = (int32_t)read_whole(parser, row->name, value, 0, 100);
        break;
    case OPTION_CHAIN_TOLERANCE:
        take_chain_tolerance(parser, row->name, value);
        break;
    case OPTION_PLACE:
        take_place(parser, row->name, value);
        break;
    case OPTION_FORMAT:
        take_format(parser, row->name, value);
        break;
    case OPTION_KEEP:
        options->keep_dir = value;
        break;
    case OPTION_DRY_RUN:
        options->dry_run = true;
        break;
    case OPTION_RESUME:
        options->resume = true;
        break;
    case OPTION_CACHE:
        options->lod.cache = 1;
        break;
    default:
        options->has_topology |= row->group == GROUP_TOPOLOGY;
        if (row->group == GROUP_TOPOLOGY)
            take_topology_option(parser, row, value);
        else
            take_job_option(parser, row, value);
        break;
    }
}

/* Says which commands take the option that this one does not. */
static void not_here(struct parser *parser, const struct option_row *row)
{
    char names[256] = "";
    for (const struct command *command = parser->commands; command->name; command++) {
        size_t used = strlen(names);
        if (command->groups & row->group)
            snprintf(names + used, sizeof names - used, "%s%s", used ? ", " : "", command->name);
    }
    misuse(parser, "--%s is an option of %s", row->name, names);
}

static void unknown(struct parser *parser, const char *word)
{
    const struct option_row *nearest = NULL;
    unsigned least = 0;
    for (size_t i = 0; i < option_row_count; i++) {
        unsigned distance = word_distance(word, option_rows[i].name);
        if ((option_rows[i].group & parser->command->groups) && (!nearest || distance < least)) {
            nearest = &option_rows[i];
            least = distance;
        }
    }
    if (nearest && is_near(word, least))
        misuse(parser, "unknown option --%s; did you mean --%s?", word, nearest->name);
    else
        misuse(parser, "unknown option --%s", word);
}

/* The option of that name; of several, the command's own (--size means two things). */
static const struct option_row *find_long(const struct command *command, const char *name,
                                          size_t length)
{
    const struct option_row *found = NULL;
    for (size_t i = 0; i < option_row_count; i++) {
        if (strlen(option_rows[i].name) == length &&
            strncmp(option_rows[i].name, name, length) == 0 &&
            (!found || (option_rows[i].group & command->groups)))
            found = &option_rows[i];
    }
    return found;
}

static const struct option_row *find_letter(char letter)
{
    for (size_t i = 0; i < option_row_count; i++) {
        if (option_rows[i].letter == letter)
            return &option_rows[i];
    }
    return NULL;
}

/* One word that begins with two dashes, and its value, which may be the next word. Returns how
 * many words were used. */
static int take_long(struct parser *parser, const char *word, const char *next, enum parsed *parsed)
{
    char name[64];
    size_t length = strcspn(word, "=");
    const char *value = word[length] == '=' ? word + length + 1 : NULL;
    const struct option_row *row = find_long(parser->command, word, length);
    snprintf(name, sizeof name, "%.*s", (int)length, word);
    if (!row) {
        unknown(parser, name);
    } else if (!(row->group & parser->command->groups)) {
        not_here(parser, row);
    } else if (!row->argument && value) {
        misuse(parser, "--%s takes no value", row->name);
    } else if (row->argument && !value && !next) {
        misuse(parser, "--%s needs a value: --%s %s", row->name, row->name, row->argument);
    } else if (row->id == OPTION_HELP || row->id == OPTION_VERSION) {
        *parsed = row->id == OPTION_HELP ? PARSED_HELP : PARSED_VERSION;
    } else {
        take_option(parser, row, !row->argument ? "" : value ? value : next);
        return row->argument && !value ? 2 : 1;
    }
    return 1;
}

/* One word of letters behind a dash: -q, -qv, -t4, -o FILE. */
static int take_letters(struct parser *parser, const char *word, const char *next,
                        enum parsed *parsed)
{
    for (; *word; word++) {
        const struct option_row *row = find_letter(*word);
        if (!row) {
            misuse(parser, "unknown option -%c", *word);
            return 1;
        }
        if (!(row->group & parser->command->groups)) {
            not_here(parser, row);
            return 1;
        }
        if (row->id == OPTION_HELP) {
            *parsed = PARSED_HELP;
            return 1;
        }
        if (!row->argument) {
            take_option(parser, row, "");
            continue;
        }
        if (word[1]) {
            take_option(parser, row, word + 1 + (word[1] == '='));
            return 1;
        }
        if (next)
            take_option(parser, row, next);
        else
            misuse(parser, "-%c needs a value: -%c %s", *word, *word, row->argument);
        return 2;
    }
    return 1;
}

/* --error alone gives the levels; with --faces or --ratio it is a bound. */
static void settle_targets(struct parser *parser)
{
    struct options *options = parser->options;
    bool is_relative = false;
    if (parser->has_faces && parser->has_ratio)
        misuse(parser, "--faces and --ratio cannot both be given");
    if (!parser->has_error)
        return;
    if (!parser->has_faces && !parser->has_ratio) {
        read_targets(parser, "error", parser->error_text, SPBM_BY_ERROR);
        return;
    }
    if (!read_length(parser->error_text, &options->target.error_bound, &is_relative) ||
        !(options->target.error_bound > 0))
        bad_value(parser, "error", parser->error_text,
                  "one error above 0, as 0.02 or 0.1% (with --faces or --ratio it is a bound)");
    options->target.bound_is_relative = is_relative;
}

/* What no single option can see. */
static void settle(struct parser *parser)
{
    const struct command *command = parser->command;
    struct options *options = parser->options;
    if (options->input_count < command->inputs_min)
        misuse(parser, "an input is missing: spbm %s %s", command->name, command->arguments);
    if (options->input_count > command->inputs_max)
        misuse(parser, "one input too many: %s", options->inputs[command->inputs_max]);
    if ((command->groups & GROUP_OUTPUT) && !options->output)
        misuse(parser, "-o OUT is missing: where to write");
    if (command->groups & GROUP_TARGET) {
        settle_targets(parser);
        if (options->target.count == 0)
            misuse(parser, "a target is missing: --faces N, --ratio R or --error E");
    }
    if ((command->groups & GROUP_FORMAT) && options->output && strcmp(options->output, "-") == 0 &&
        options->lod.format == SPBM_FORMAT_BY_NAME)
        misuse(parser, "-o - needs --format: standard output has no ending that would tell");
    if (options->json && options->output && strcmp(options->json, "-") == 0 &&
        strcmp(options->output, "-") == 0)
        misuse(parser, "--json - and -o - cannot both go to standard output");
    if (options->resume && !options->tmp_dir)
        misuse(parser, "--resume needs --tmp DIR: where finished stages are kept");
    if (options->resume && options->keep_dir)
        misuse(parser, "--resume and --keep cannot both be given");
    if (options->lod.cache && options->has_topology)
        misuse(parser, "--cache and options that remove features cannot both be given");
    if (options->quiet && options->verbose)
        misuse(parser, "--quiet and --verbose cannot both be given");
}

static void set_defaults(struct options *options)
{
    memset(options, 0, sizeof *options);
    spbm_target_defaults(&options->target);
    spbm_patch_defaults(&options->patch);
    spbm_lod_defaults(&options->lod);
    spbm_measure_defaults(&options->measure);
    spbm_render_defaults(&options->render);
    spbm_topology_defaults(&options->topology);
}

enum parsed options_parse(const struct command *command, const struct command *commands, int argc,
                          char **argv, struct options *options)
{
    struct parser parser = {.command = command, .commands = commands, .options = options};
    enum parsed parsed = PARSED_RUN;
    set_defaults(options);
    options->inputs = calloc((size_t)argc + 1, sizeof *options->inputs);
    if (!options->inputs) {
        fprintf(stderr, "spbm: not enough memory\n");
        return PARSED_MISUSE;
    }
    bool has_ended = false;
    for (int i = 0; i < argc && parsed == PARSED_RUN;) {
        const char *word = argv[i], *next = i + 1 < argc ? argv[i + 1] : NULL;
        if (has_ended || word[0] != '-' || word[1] == '\0') {
            options->inputs[options->input_count++] = word;
            i++;
        } else if (strcmp(word, "--") == 0) {
            has_ended = true;
            i++;
        } else if (word[1] == '-') {
            i += take_long(&parser, word + 2, next, &parsed);
        } else {
            i += take_letters(&parser, word + 1, next, &parsed);
        }
    }
    if (parsed != PARSED_RUN)
        return parsed;
    settle(&parser);
    if (!parser.failure[0])
        return PARSED_RUN;
    fprintf(stderr, "spbm %s: %s (spbm %s --help tells more)\n", command->name, parser.failure,
            command->name);
    return PARSED_MISUSE;
}

void options_clear(struct options *options)
{
    free(options->inputs);
    options->inputs = NULL;
}
