/*
 * Figures of stores, chain files and meshes: as JSON (keys: doc/json.md) and as lines for people.
 */
#ifndef SPBM_TOOLS_FIGURES_H
#define SPBM_TOOLS_FIGURES_H

#include <jansson.h>
#include <stdio.h>

#include "spbm.h"

/* Sets a key; a NULL value (no memory) and numbers that JSON has no words for become null. */
void set_json(json_t *object, const char *key, json_t *value);
void set_count(json_t *object, const char *key, uint64_t count);
void set_real(json_t *object, const char *key, double number);
void set_text(json_t *object, const char *key, const char *text); /* NULL: null */
void set_truth(json_t *object, const char *key, int truth);

/* New references. */
json_t *json_of_store(const spbm_store_figures *store);
json_t *json_of_chains(const spbm_chain_figures *chains);
json_t *json_of_quality(const spbm_quality *quality);
json_t *json_of_deviation(const spbm_deviation *deviation);

void write_store(FILE *file, const spbm_store_figures *store);
void write_chains(FILE *file, const spbm_chain_figures *chains);
void write_quality(FILE *file, const spbm_quality *quality);

/* What import dropped and mended, a line each, zeros left out, `indent` in front. */
void write_cleaning(FILE *file, const char *indent, const spbm_cleaning *cleaning);

/* "1,087,716 faces, 543,860 vertices, 1 component, closed" and no newline. */
void write_summary(FILE *file, const spbm_topology *topology);

#endif
