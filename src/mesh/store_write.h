/*
 * Writing the store's sections from a draft that is done.
 */
#ifndef SPBM_MESH_STORE_WRITE_H
#define SPBM_MESH_STORE_WRITE_H

#include "base/section_file.h"
#include "mesh/slab_geometry.h"
#include "mesh/store_hold.h"
#include "mesh/survey.h"

/*
 * Writes all sections. `info` is complete but for what is measured here: mean_edge, noise, area,
 * zero-area faces. The file is not finished.
 *
 * With a survey (else NULL) the slabs are surveyed while they are in hand; info->topology is what
 * that finds. If it is not clean, the slabs were written in vain, and the sections behind them are
 * left out: the file is to be begun again. survey_clear is due.
 *
 * With `hold` (else NULL) the slabs that it takes are left out, and it has them when all is well.
 */
enum status store_write(struct draft *draft, const struct frame *frame,
                        struct section_writer *writer, struct store_info *info,
                        struct survey *survey, struct store_hold *hold) MUST_CHECK;

#endif
