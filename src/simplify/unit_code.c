/*
 * Three floats of a unit vector take twelve bytes that no compressor makes smaller, more than all
 * else that a patch keeps. Its angles would need sine and cosine to come back; the octahedron needs
 * one square root, which is the same on every machine.
 */
#include "simplify/unit_code.h"

#include <math.h>
#include <stdlib.h>

enum { UNIT_STEPS = 32767 };

/* 1 or -1, without a branch, which would be a coin's toss. */
static double sign_of(double value)
{
    return 1 - 2 * (value < 0);
}

static int round_steps(double value)
{
    return (int)(value * UNIT_STEPS + 0.5 * sign_of(value));
}

/* On the rim of the square, which is where the lower half was cut open, (a, rim) and (-a, rim) are
 * the same point: one of the two codes is used. */
static void choose_on_rim(int *one, int *other)
{
    if (abs(*one) == UNIT_STEPS)
        *other = abs(*other);
    if (abs(*other) == UNIT_STEPS)
        *one = abs(*one);
}

uint32_t unit_encode(const double vector[3])
{
    double sum = fabs(vector[0]) + fabs(vector[1]) + fabs(vector[2]);
    if (!(sum > 0))
        return 0;
    double u = vector[0] / sum, v = vector[1] / sum;
    if (vector[2] < 0) {
        double folded = (1 - fabs(v)) * sign_of(u);
        v = (1 - fabs(u)) * sign_of(v);
        u = folded;
    }
    int a = round_steps(u), b = round_steps(v);
    choose_on_rim(&a, &b);
    return ((uint32_t)a & 0xffff) | (uint32_t)b << 16;
}

int unit_decode(uint32_t code, float unit[3])
{
    int a = (int16_t)(code & 0xffff), b = (int16_t)(code >> 16);
    int c = a, d = b;
    choose_on_rim(&c, &d);
    if (abs(a) > UNIT_STEPS || abs(b) > UNIT_STEPS || c != a || d != b)
        return 0;
    double u = (double)a / UNIT_STEPS, v = (double)b / UNIT_STEPS;
    double x = u, y = v, z = 1 - fabs(u) - fabs(v);
    if (z < 0) {
        x = (1 - fabs(v)) * sign_of(u);
        y = (1 - fabs(u)) * sign_of(v);
    }
    double length = sqrt(x * x + y * y + z * z);
    unit[0] = (float)(x / length + 0.0); /* no negative zeros */
    unit[1] = (float)(y / length + 0.0);
    unit[2] = (float)(z / length + 0.0);
    return 1;
}
