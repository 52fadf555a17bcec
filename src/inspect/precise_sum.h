/*
 * A sum of many numbers of any size whose rounding errors are carried along (A. Neumaier,
 * "Rundungsfehleranalyse einiger Verfahren zur Summation endlicher Summen", 1974).
 */
#ifndef SPBM_INSPECT_PRECISE_SUM_H
#define SPBM_INSPECT_PRECISE_SUM_H

#include <math.h>

struct precise_sum { /* all zero to begin with */
    double sum, rest;
};

static inline void precise_add(struct precise_sum *total, double value)
{
    double sum = total->sum + value;
    total->rest +=
        fabs(total->sum) >= fabs(value) ? (total->sum - sum) + value : (value - sum) + total->sum;
    total->sum = sum;
}

static inline double precise_value(const struct precise_sum *total)
{
    return total->sum + total->rest;
}

#endif
