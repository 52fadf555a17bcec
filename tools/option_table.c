/*
 * Options and their help. Defaults that the library sets stand as @name@ and are filled in when the
 * help is printed, so that help cannot be wrong about them.
 */
#include "option_table.h"

#include <stdio.h>
#include <string.h>

#include "limits.h"
#include "options.h"
#include "values.h"

const struct option_row option_rows[] = {
    {OPTION_OUTPUT, GROUP_OUTPUT, 'o', "output", "OUT",
     "where to write; - is standard output (required)"},
    {OPTION_FORMAT, GROUP_FORMAT, 0, "format", "F",
     "ply, ply-ascii, ply-big, obj, stl or off (default: by OUT's\n"
     "ending; needed for -o -)"},
    {OPTION_WELD, GROUP_WELD, 0, "weld", NULL,
     "merge coincident vertices of indexed inputs too (default: off;\n"
     "STL is always welded)"},
    {OPTION_FACES, GROUP_TARGET, 'n', "faces", "N[,N...]",
     "faces of each level, for instance 50k,10k,2000"},
    {OPTION_RATIO, GROUP_TARGET, 'r', "ratio", "R[,R...]",
     "or: fraction of the input's faces, 0.05 or 5%"},
    {OPTION_ERROR, GROUP_TARGET, 'e', "error", "E[,E...]",
     "or: estimated largest distance to the original, a length, or\n"
     "with % a fraction of the bounding box's diagonal; one value\n"
     "together with --faces or --ratio: what is reached first stops"},
    {OPTION_MODE, GROUP_TARGET, 0, "mode", "M",
     "classic: merges patches, for CAD parts; collapse: collapses\n"
     "edges of fine patches, for scans (default: @mode@)"},
    {OPTION_EFFORT, GROUP_TARGET, 0, "effort", "N", "1 fastest to 3 most accurate (default: 2)"},
    {OPTION_PATCH_ANGLE, GROUP_PATCH, 0, "patch-angle", "A[,A2]",
     "degrees that a face may lean from its patch; A2: faces that\n"
     "share two edges with it (default: chosen from the scan's noise)"},
    {OPTION_FACE_ANGLE, GROUP_PATCH, 0, "face-angle", "A[,A2]",
     "the same from the neighbouring face (default: chosen)"},
    {OPTION_SMOOTH, GROUP_PATCH, 0, "smooth", "N",
     "times the face normals are averaged with their neighbours'\n"
     "(default: chosen)"},
    {OPTION_CHAIN_TOLERANCE, GROUP_PATCH, 0, "chain-tolerance", "E",
     "mode collapse: chains are simplified by this before edges are\n"
     "collapsed; a length, or with % a fraction of the diagonal\n"
     "(default: chosen)"},
    {OPTION_PLACE, GROUP_PLACE, 0, "place", "P",
     "subset: output vertices are input vertices, bit for bit;\n"
     "optimal: where the error is least (default: subset in mode\n"
     "classic, optimal in mode collapse)"},
    {OPTION_KEEP, GROUP_KEEP, 0, "keep", "DIR",
     "keep DIR/mesh.store and DIR/mesh.chains (default: temporary)"},
    {OPTION_RESUME, GROUP_KEEP, 0, "resume", NULL,
     "keep finished stages in a folder in --tmp DIR until the run is\n"
     "done; after a crash or kill the same command goes on from them\n"
     "(default: off)"},
    {OPTION_DRY_RUN, GROUP_KEEP, 0, "dry-run", NULL,
     "only say what time, disk and memory the run would take"},
    {OPTION_CACHE, GROUP_CACHE, 0, "cache", NULL,
     "leave in CHAINS what makes further levels with the same effort\n"
     "and placement cheap, as simplify --keep does (default: off)"},
    {OPTION_SAMPLES, GROUP_MEASURE, 0, "samples", "N",
     "samples for each face of the simplified mesh (default: 10)"},
    {OPTION_SELF_INTERSECTIONS, GROUP_MEASURE, 0, "self-intersections", NULL,
     "count faces that cut through others (default: off)"},
    {OPTION_ERROR_PLY, GROUP_MEASURE, 0, "error-ply", "OUT",
     "write SIMPLIFIED to OUT (.ply) with each vertex's distance to\n"
     "ORIGINAL as property `quality` and as a colour; spbm render\n"
     "shows it with a legend (default: not written)"},
    {OPTION_SIZE, GROUP_RENDER, 0, "size", "WxH",
     "pixels of each picture of the row (default: @size@)"},
    {OPTION_VIEW, GROUP_RENDER, 0, "view", "X,Y,Z",
     "direction from the model to the eye (default: chosen)"},
    {OPTION_UP, GROUP_RENDER, 0, "up", "X,Y,Z", "direction that is up (default: chosen)"},
    {OPTION_WIREFRAME, GROUP_RENDER, 'w', "wireframe", NULL, "draw the edges too (default: off)"},
    {OPTION_SHADING, GROUP_RENDER, 0, "shading", "S",
     "flat: faces can be told apart; smooth: they melt into each\n"
     "other (default: @shading@)"},
    {OPTION_LEGEND, GROUP_RENDER, 0, "legend", "TEXT",
     "words under the legend of meshes that have a `quality`\n"
     "(default: quality)"},
    {OPTION_NO_CAPTIONS, GROUP_RENDER, 0, "no-captions", NULL,
     "no names and counts below (default: with them)"},
    {OPTION_BACKGROUND, GROUP_RENDER, 0, "background", "RRGGBB",
     "colour behind the meshes (default: @background@)"},
    {OPTION_MAX_FEATURE, GROUP_TOPOLOGY, 0, "max-feature", "SIZE",
     "remove holes, bumps and cavities that are smaller; a length, or\n"
     "with % a fraction of the bounding box's diagonal"},
    {OPTION_FEATURE_SIZE, GROUP_TOPOLOGY, 0, "size", "M",
     "how large a feature is: exact: the diameter of its largest loop;\n"
     "sampled: the same, estimated; box: the diagonal of its box;\n"
     "extent: the diameter of the whole feature (default: exact)"},
    {OPTION_SHARP_ANGLE, GROUP_TOPOLOGY, 0, "sharp-angle", "A[,MAX]",
     "degrees between neighbours above which an edge is sharp, and at\n"
     "most (default: 45,180)"},
    {OPTION_KEEP_PIPES, GROUP_TOPOLOGY, 0, "keep-pipes", NULL,
     "keep what is solid between two loops (default: on)"},
    {OPTION_REMOVE_PIPES, GROUP_TOPOLOGY, 0, "remove-pipes", NULL,
     "remove it, too, like a hole (default: off)"},
    {OPTION_SMOOTH_FEATURES, GROUP_TOPOLOGY, 0, "smooth-features", NULL,
     "with --max-feature: also handles and tunnels without sharp rims,\n"
     "by their shortest loop (default: off)"},
    {OPTION_DROP_COMPONENTS, GROUP_TOPOLOGY, 0, "drop-components", "SIZE",
     "drop components whose box has a smaller diagonal"},
    {OPTION_CLOSE_CRACKS, GROUP_TOPOLOGY, 0, "close-cracks", "SIZE",
     "fill border loops that are smaller"},
    {OPTION_CRACK_SIZE, GROUP_TOPOLOGY, 0, "crack-size", "M",
     "how large a border loop is: diameter, or inscribed: that of the\n"
     "largest circle inside (default: diameter)"},
    {OPTION_ZIP_TOLERANCE, GROUP_TOPOLOGY, 0, "zip-tolerance", "SIZE",
     "how far apart the sides of a crack may lie that become one before\n"
     "it is filled; 0: none (default: a tenth of the median border edge)"},
    {OPTION_MERGE_COPLANAR, GROUP_TOPOLOGY, 0, "merge-coplanar", NULL,
     "triangulate planes anew, by the fewest triangles (default: off)"},
    {OPTION_MEMORY, GROUP_SHARED, 'm', "memory", "SIZE",
     "memory budget; K, M, G are binary (default: half of what\n"
     "machine, control group or Slurm give; here @memory@)"},
    {OPTION_THREADS, GROUP_SHARED, 't', "threads", "N",
     "threads (default: the processors of this process, at most\n"
     "SLURM_CPUS_PER_TASK and OMP_NUM_THREADS; here @threads@)"},
    {OPTION_TMP, GROUP_SHARED, 0, "tmp", "DIR",
     "temporary files (default: $TMPDIR, else beside the output)"},
    {OPTION_JSON, GROUP_SHARED, 0, "json", "FILE",
     "write a report for programs; - is standard output"},
    {OPTION_QUIET, GROUP_SHARED, 'q', "quiet", NULL, "errors and warnings only"},
    {OPTION_VERBOSE, GROUP_SHARED, 'v', "verbose", NULL,
     "say what was chosen and what each stage took"},
    {OPTION_HELP, GROUP_SHARED, 'h', "help", NULL, "this help"},
    {OPTION_VERSION, GROUP_SHARED, 0, "version", NULL, "the version"},
};

const size_t option_row_count = sizeof option_rows / sizeof option_rows[0];

/* The text for an @name@. */
static void write_default(FILE *file, const char *name, size_t length)
{
    spbm_target target;
    spbm_render_options render;
    struct limits limits;
    limits_find(&limits);
    spbm_target_defaults(&target);
    spbm_render_defaults(&render);
    if (strncmp(name, "mode", length) == 0)
        fputs(target.mode == SPBM_CLASSIC ? "classic" : "collapse", file);
    else if (strncmp(name, "size", length) == 0)
        fprintf(file, "%ux%u", render.width, render.height);
    else if (strncmp(name, "shading", length) == 0)
        fputs(render.flat ? "flat" : "smooth", file);
    else if (strncmp(name, "background", length) == 0)
        fprintf(file, "%06x", render.background);
    else if (strncmp(name, "memory", length) == 0)
        fputs(size_text(limits.memory).s, file);
    else if (strncmp(name, "threads", length) == 0)
        fprintf(file, "%u", limits.threads);
}

static void write_row(FILE *file, const struct option_row *row)
{
    enum { COLUMN = 29 };
    char words[64], letter[8] = "    ";
    if (row->letter)
        snprintf(letter, sizeof letter, "-%c, ", row->letter);
    int width = snprintf(words, sizeof words, "  %s--%s%s%s", letter, row->name,
                         row->argument ? " " : "", row->argument ? row->argument : "");
    fputs(words, file);
    if (width >= COLUMN) {
        fputc('\n', file);
        width = 0;
    }
    fprintf(file, "%*s", COLUMN - width, "");
    for (const char *at = row->help; *at; at++) {
        const char *end = *at == '@' ? strchr(at + 1, '@') : NULL;
        if (end) {
            write_default(file, at + 1, (size_t)(end - at - 1));
            at = end;
        } else if (*at == '\n') {
            fprintf(file, "\n%*s", COLUMN, "");
        } else {
            fputc(*at, file);
        }
    }
    fputc('\n', file);
}

void options_help(const struct command *command, FILE *file)
{
    const struct {
        unsigned groups;
        const char *title;
    } sections[] = {
        {GROUP_OUTPUT | GROUP_FORMAT | GROUP_KEEP | GROUP_CACHE, "Output"},
        {GROUP_WELD, "Input"},
        {GROUP_TARGET, "Target (one of the first three is needed)"},
        {GROUP_PATCH, "Patches"},
        {GROUP_PLACE, "Vertices"},
        {GROUP_TOPOLOGY, command->groups & GROUP_TARGET
                             ? "Topology (kept unless something is to be removed)"
                             : "What is removed (one at least is needed)"},
        {GROUP_MEASURE, "Measuring"},
        {GROUP_RENDER, "Picture"},
        {GROUP_SHARED, "Any command"},
    };
    fprintf(file, "spbm %s: %s\n\nusage: spbm %s %s\n\n%s", command->name, command->summary,
            command->name, command->arguments, command->details);
    for (size_t s = 0; s < sizeof sections / sizeof sections[0]; s++) {
        if (!(sections[s].groups & command->groups))
            continue;
        fprintf(file, "\n%s:\n", sections[s].title);
        for (size_t i = 0; i < option_row_count; i++) {
            if (option_rows[i].group & sections[s].groups & command->groups)
                write_row(file, &option_rows[i]);
        }
    }
}
