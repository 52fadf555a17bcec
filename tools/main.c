/*
 * spbm: the program. A table of commands; what each does stands in cmd_NAME.c, what they share in
 * run.c.
 */
#include <stdio.h>
#include <string.h>

#include "commands.h"
#include "values.h"

#define SIMPLIFY_OPTIONS \
    (GROUP_SHARED | GROUP_OUTPUT | GROUP_WELD | GROUP_TARGET | GROUP_PATCH | GROUP_PLACE | \
     GROUP_FORMAT | GROUP_KEEP | GROUP_TOPOLOGY)

static const struct command commands[] = {
    {"simplify", "Simplify", "IN... -o OUT TARGET [options]",
     "mesh files in, simplified meshes out",
     "Does import, patchify and lod in one run, with temporary files. IN are PLY, OBJ, STL or OFF\n"
     "files, plain or gzip-compressed, - is standard input; several are one mesh. With several\n"
     "levels OUT holds %d, which becomes the level's number (0 is the finest; %% is a percent\n"
     "sign). The topology is kept unless small features are to be removed first.\n"
     "\n"
     "  spbm simplify scan.ply.gz -o small.ply --faces 10k\n"
     "  spbm simplify scan.ply -o 'level-%d.ply' --faces 100k,10k,1k\n"
     "  spbm simplify part.stl -o part.obj --mode classic --error 0.1%\n"
     "  spbm simplify part.stl -o part.obj --mode classic --max-feature 5 --faces 100\n",
     SIMPLIFY_OPTIONS, 1, UINT32_MAX, cmd_simplify},
    {"import", "One stage at a time", "IN... -o STORE [options]",
     "stage 1: mesh files to a mesh store",
     "Reads and cleans meshes and writes the mesh store, which the other stages map. What was\n"
     "cleaned is said. Several IN are one mesh; - is standard input.\n"
     "\n"
     "  spbm import scan.ply.gz -o scan.store\n",
     GROUP_SHARED | GROUP_OUTPUT | GROUP_WELD, 1, UINT32_MAX, cmd_import},
    {"patchify", "One stage at a time", "STORE -o CHAINS TARGET [options]",
     "stage 2: a mesh store to a chain file",
     "Grows patches, fine enough for the finest level of TARGET, and writes the chains between\n"
     "them. The surface is not needed any more after this.\n"
     "\n"
     "  spbm patchify scan.store -o scan.chains --faces 100k,10k\n",
     GROUP_SHARED | GROUP_OUTPUT | GROUP_TARGET | GROUP_PATCH, 1, 1, cmd_patchify},
    {"lod", "One stage at a time", "CHAINS -o OUT TARGET [options]",
     "stage 3: a chain file to simplified meshes",
     "Makes one or several levels of detail. TARGET should be what the chain file was made for;\n"
     "coarser levels are always possible. With several levels OUT holds %d, which becomes the\n"
     "level's number (0 is the finest; %% is a percent sign).\n"
     "\n"
     "  spbm lod scan.chains -o 'level-%d.ply' --faces 100k,10k\n"
     "  spbm lod part.chains -o part.ply --faces 100 --max-feature 2\n",
     GROUP_SHARED | GROUP_OUTPUT | GROUP_TARGET | GROUP_PLACE | GROUP_TOPOLOGY | GROUP_FORMAT |
         GROUP_CACHE,
     1, 1, cmd_lod},
    {"export", "One stage at a time", "STORE -o OUT [options]",
     "writes a mesh store's mesh as a mesh file",
     "Writes the cleaned mesh at full size, streamed.\n"
     "\n"
     "  spbm export scan.store -o clean.ply\n",
     GROUP_SHARED | GROUP_OUTPUT | GROUP_FORMAT, 1, 1, cmd_export},
    {"topology", "Topology", "IN... -o OUT [options]",
     "removes small holes, bumps, cavities, cracks and specks",
     "Removes features below a size and nothing else: all other faces are written as they are. IN\n"
     "are mesh files (several are one mesh) or one mesh store. What was removed is listed with\n"
     "--verbose and --json.\n"
     "\n"
     "  spbm topology part.stl -o plain.stl --max-feature 5\n"
     "  spbm topology part.stl -o plain.stl --max-feature 3% --merge-coplanar\n"
     "  spbm topology scan.ply -o clean.ply --drop-components 3% --close-cracks 2%\n",
     GROUP_SHARED | GROUP_OUTPUT | GROUP_WELD | GROUP_FORMAT | GROUP_TOPOLOGY, 1, UINT32_MAX,
     cmd_topology},
    {"info", "Look at files", "FILE [options]", "what a mesh, mesh store or chain file holds",
     "Describes FILE on standard output: counts, topology, the floor (the fewest faces that its\n"
     "topology allows), and what it was made from.\n",
     GROUP_SHARED, 1, 1, cmd_info},
    {"check", "Look at files", "FILE [options]", "verifies a mesh, mesh store or chain file",
     "Exit code 0: a store or chain file is whole and keeps every invariant, a mesh is manifold\n"
     "(with or without border), consistently oriented, without degenerate and duplicate faces.\n"
     "Exit code 1: the first thing that is wrong is said.\n",
     GROUP_SHARED, 1, 1, cmd_check},
    {"measure", "Look at files", "ORIGINAL SIMPLIFIED [options]",
     "distances both ways, normals, topology",
     "Measures how far a simplified mesh is from its original (a mesh file or store), on standard\n"
     "output.\n"
     "\n"
     "  spbm measure scan.ply.gz small.ply\n"
     "  spbm measure scan.ply.gz small.ply --error-ply error.ply\n"
     "  spbm render error.ply -o error.png --legend 'distance to the original'\n",
     GROUP_SHARED | GROUP_MEASURE, 2, 2, cmd_measure},
    {"render", "Look at files", "MESH... -o PICTURE.png [options]", "a picture of meshes",
     "Draws mesh files and stores side by side at one scale. A chain file behind the store that\n"
     "it was made from colours its patches; meshes with a vertex property `quality`, such as "
     "measure\n"
     "--error-ply writes, are coloured by it, with a legend.\n"
     "\n"
     "  spbm render scan.ply small.ply -o both.png --wireframe\n"
     "  spbm render scan.store scan.chains -o patches.png\n",
     GROUP_SHARED | GROUP_OUTPUT | GROUP_RENDER, 1, UINT32_MAX, cmd_render},
    {NULL, NULL, NULL, NULL, NULL, 0, 0, 0, NULL},
};

static void program_help(FILE *file)
{
    const char *section = "";
    fprintf(file,
            "spbm %s: simplifies triangle scans too large for memory\n"
            "\n"
            "usage: spbm COMMAND ... [options]\n",
            spbm_version());
    for (const struct command *command = commands; command->name; command++) {
        if (strcmp(section, command->section) != 0)
            fprintf(file, "\n%s:\n", command->section);
        section = command->section;
        fprintf(file, "  %-10s %s\n", command->name, command->summary);
    }
    fputs(
        "\n"
        "spbm COMMAND --help tells the options of each with their defaults, man spbm all of it.\n"
        "\n"
        "  spbm simplify scan.ply.gz -o small.ply --faces 10k\n"
        "\n"
        "Lengths are in the model's own units; % behind an error or tolerance is that part of the\n"
        "bounding box's diagonal. Angles are degrees. Sizes take K, M, G (binary), counts k, M.\n"
        "\n"
        "Exit codes: 0 done; 1 bad input or failed; 2 misuse; 3 target not reached, output "
        "written;\n"
        "4 no memory or disk left; 128 + n after signal n.\n",
        file);
}

static const struct command *find_command(const char *name)
{
    const struct command *nearest = NULL;
    unsigned least = 0;
    if (name[0] == '-') {
        fprintf(stderr, "spbm: the command comes before %s: spbm COMMAND ... [options]\n", name);
        return NULL;
    }
    for (const struct command *command = commands; command->name; command++) {
        unsigned distance = word_distance(name, command->name);
        if (distance == 0)
            return command;
        if (!nearest || distance < least) {
            nearest = command;
            least = distance;
        }
    }
    if (nearest && is_near(name, least))
        fprintf(stderr, "spbm: unknown command %s; did you mean %s? (spbm --help lists all)\n",
                name, nearest->name);
    else
        fprintf(stderr, "spbm: unknown command %s (spbm --help lists all)\n", name);
    return NULL;
}

static int run(const struct command *command, int argc, char **argv)
{
    struct options options;
    int exit_code = EXIT_DONE;
    switch (options_parse(command, commands, argc, argv, &options)) {
    case PARSED_RUN:
        exit_code = run_command(command, &options);
        break;
    case PARSED_HELP:
        options_help(command, stdout);
        break;
    case PARSED_VERSION:
        printf("spbm %s\n", spbm_version());
        break;
    case PARSED_MISUSE:
        exit_code = EXIT_MISUSE;
        break;
    }
    options_clear(&options);
    return exit_code;
}

int main(int argc, char **argv)
{
    const char *word = argc > 1 ? argv[1] : "";
    if (argc < 2) {
        program_help(stderr);
        return EXIT_MISUSE;
    }
    if (strcmp(word, "--version") == 0) {
        printf("spbm %s\n", spbm_version());
        return EXIT_DONE;
    }
    if (strcmp(word, "help") == 0 && argc > 2) {
        const struct command *command = find_command(argv[2]);
        if (command)
            options_help(command, stdout);
        return command ? EXIT_DONE : EXIT_MISUSE;
    }
    if (strcmp(word, "help") == 0 || strcmp(word, "--help") == 0 || strcmp(word, "-h") == 0) {
        program_help(stdout);
        return EXIT_DONE;
    }
    const struct command *command = find_command(word);
    return command ? run(command, argc - 2, argv + 2) : EXIT_MISUSE;
}
