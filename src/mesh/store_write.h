/*
 * Writing the store's sections from a draft that is done.
 */
#ifndef SPBM_MESH_STORE_WRITE_H
#define SPBM_MESH_STORE_WRITE_H

#include "base/section_file.h"
#include "mesh/slab_geometry.h"

/*
 * Writes all sections. `info` is complete but for what is measured here: mean_edge, noise, area,
 * zero-area faces. The file is not finished.
 */
enum status store_write(struct draft *draft, const struct frame *frame,
                        struct section_writer *writer, struct store_info *info) MUST_CHECK;

#endif
