/*
 * From a float32 or double to the shortest decimal text that gives it back.
 *
 * printf with 17 digits is correct but long and slow, and which precision is enough is not known
 * before: trying all of them takes microseconds a number. Here the number is scaled to an integer
 * with all the digits that could be needed, exactly, in 128 bits:
 *
 *   1. For v = m * 2^e a power of ten s is chosen so that v * 10^s has 17 or 18 digits before the
 *      point (float32: 9 or 10). v * 10^s = m * 5^s * 2^(e+s) is held as value / unit, both exact
 *      integers; so are the distances to the midpoints with v's neighbours, the bounds within
 *      which a decimal is parsed as v.
 *   2. Any decimal of at most 15 digits (float32: 6) that gives v back is v rounded to 15 digits:
 *      half a unit of the 15th digit is more than half a unit of v's last bit. So v is rounded to
 *      15 digits, and if this lies within the bounds it has the digits, behind which zeros are cut
 *      off. Else 16 digits are tried, and 17 always do (float32: 7, 8, 9).
 *   3. Numbers whose scaled value needs more than 126 bits (doubles below 1e-14 or above 1e37,
 *      floats below 1e-34 or above 1e37) take printf's digits, whose correct rounding the C library
 *      guarantees, and are checked with parse_real.
 */
#include "mesh/format_number.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/parse_number.h"

typedef unsigned __int128 wide;

static const uint64_t powers_of_ten[] = {1u,
                                         10u,
                                         100u,
                                         1000u,
                                         10000u,
                                         100000u,
                                         1000000u,
                                         10000000u,
                                         100000000u,
                                         1000000000u,
                                         10000000000u,
                                         100000000000u,
                                         1000000000000u,
                                         10000000000000u,
                                         100000000000000u,
                                         1000000000000000u,
                                         10000000000000000u,
                                         100000000000000000u,
                                         1000000000000000000u,
                                         10000000000000000000u};

/* All powers of five that 64 bits hold. */
enum { LARGEST_POWER_OF_FIVE = 27 };
static const uint64_t powers_of_five[] = {1u,
                                          5u,
                                          25u,
                                          125u,
                                          625u,
                                          3125u,
                                          15625u,
                                          78125u,
                                          390625u,
                                          1953125u,
                                          9765625u,
                                          48828125u,
                                          244140625u,
                                          1220703125u,
                                          6103515625u,
                                          30517578125u,
                                          152587890625u,
                                          762939453125u,
                                          3814697265625u,
                                          19073486328125u,
                                          95367431640625u,
                                          476837158203125u,
                                          2384185791015625u,
                                          11920928955078125u,
                                          59604644775390625u,
                                          298023223876953125u,
                                          1490116119384765625u,
                                          7450580596923828125u};

/* A type of floating point number. */
struct precision {
    int mantissa_bits;
    int exponent_bias;
    int sure_digits;   /* a decimal of so many digits survives the way to binary and back */
    int enough_digits; /* so many give every value back */
    int largest_scale; /* largest s for which 4 * m * 5^s is below 2^126 */
    bool is_float32;
};

static const struct precision float_precision = {24, 127, 6, 9, 43, true};
static const struct precision double_precision = {53, 1023, 15, 17, 30, false};

/* A positive finite number, mantissa * 2^exponent. */
struct binary {
    double value;
    uint64_t mantissa;
    int exponent;
    bool is_subnormal;
    bool is_narrow_below; /* a power of two: the neighbour below is half as far as that above */
};

/* digits * 10^exponent */
struct decimal {
    uint64_t digits;
    int exponent;
};

/* v * 10^scale as value / unit. */
struct scaled {
    wide value;        /* below 2^126 */
    wide unit;         /* not above the value */
    wide below, above; /* distances to the midpoints with the neighbours */
    wide margin;       /* how much nearer than a midpoint a decimal must be */
    bool takes_midpoints;
    int scale;
    uint64_t digits; /* value / unit, rounded down */
    int digit_count;
    wide rest; /* value - digits * unit */
};

/* ---- digits ---- */

static int count_digits(uint64_t value)
{
    value |= 1; /* 0 has one digit; for all others the number of digits is the same */
    int count = ((64 - __builtin_clzll(value)) * 1233) >> 12; /* bits * log10(2) */
    return count + (value >= powers_of_ten[count]);
}

static char *put_digits(char *to, uint64_t value, int count)
{
    char *at = to + count;
    while (at - to >= 2) {
        unsigned pair = (unsigned)(value % 100);
        value /= 100;
        at -= 2;
        at[0] = (char)('0' + pair / 10);
        at[1] = (char)('0' + pair % 10);
    }
    if (at > to)
        *to = (char)('0' + value);
    return to + count;
}

static char *put_text(char *to, const char *text)
{
    size_t length = strlen(text);
    memcpy(to, text, length);
    return to + length;
}

static void cut_zeros(struct decimal *decimal)
{
    while (decimal->digits % 10 == 0) {
        decimal->digits /= 10;
        decimal->exponent++;
    }
}

/* ---- exactly, in 128 bits ---- */

static wide power_of_five(int power)
{
    if (power <= LARGEST_POWER_OF_FIVE)
        return powers_of_five[power];
    return (wide)powers_of_five[LARGEST_POWER_OF_FIVE] *
           powers_of_five[power - LARGEST_POWER_OF_FIVE];
}

/* False when 128 bits are not enough. */
static bool scale_up(const struct binary *number, const struct precision *precision,
                     struct scaled *scaled)
{
    int top_bit = number->exponent + 63 - __builtin_clzll(number->mantissa);
    if (top_bit >= 124 || number->is_subnormal)
        return false;
    /* 10^lead <= 2^top_bit <= v; the factor is log10(2), good enough for all exponents. */
    int lead = (top_bit * 78913) >> 18;
    int s = precision->enough_digits - 1 - lead;
    if (s > precision->largest_scale)
        return false;

    /* Everything times 4, so that the nearer midpoint below a power of two is an integer too. */
    wide power = s >= 0 ? power_of_five(s) : 1;
    int shift = s >= 0 ? 2 - number->exponent - s : -number->exponent;
    int up = shift < 0 ? -shift : 0;
    scaled->scale = s;
    scaled->value = (number->mantissa * power * 4) << up;
    scaled->above = (2 * power) << up;
    scaled->below = number->is_narrow_below ? power << up : scaled->above;
    scaled->takes_midpoints = number->mantissa % 2 == 0;
    if (s >= 0) {
        int down = shift > 0 ? shift : 0;
        scaled->unit = (wide)1 << down;
        scaled->digits = (uint64_t)(scaled->value >> down);
    } else {
        scaled->unit = (power_of_five(-s) << -s) * 4;
        scaled->digits = (uint64_t)(scaled->value / scaled->unit);
    }
    scaled->rest = scaled->value - scaled->digits * scaled->unit;
    scaled->digit_count = count_digits(scaled->digits);
    /* Who parses a double first and then rounds to float32 may come from just inside to the
     * midpoint, by half a unit of the double, and then to the even neighbour. */
    scaled->margin =
        precision->is_float32 && !scaled->takes_midpoints ? (scaled->value >> 52) + 1 : 0;
    return true;
}

/* Rounds to `count` digits, ties to even. False when the result is not parsed as the number. */
static bool round_to(const struct scaled *scaled, int count, struct decimal *out)
{
    int dropped = scaled->digit_count - count;
    uint64_t ten = powers_of_ten[dropped];
    uint64_t digits = scaled->digits / ten;
    wide unit = ten * scaled->unit;
    wide off = (scaled->digits - digits * ten) * scaled->unit + scaled->rest;
    wide bound = scaled->below;
    if (2 * off > unit || (2 * off == unit && digits % 2 == 1)) {
        digits++;
        off = unit - off;
        bound = scaled->above;
    }
    *out = (struct decimal){digits, dropped - scaled->scale};
    return off + scaled->margin < bound || (off == bound && scaled->takes_midpoints);
}

static bool shorten_exactly(const struct binary *number, const struct precision *precision,
                            struct decimal *out)
{
    struct scaled scaled;
    if (!scale_up(number, precision, &scaled))
        return false;
    int count = precision->sure_digits;
    while (!round_to(&scaled, count, out))
        if (++count > precision->enough_digits)
            return false; /* cannot be; the general road would have it */
    cut_zeros(out);
    return true;
}

/* ---- the general road ---- */

/* The decimal is parsed as the value; as a float32 also when it is parsed as one directly: then the
 * double nearest to it must not be the midpoint of two floats. */
static bool gives_back(const struct decimal *decimal, double value,
                       const struct precision *precision)
{
    char text[NUMBER_TEXT_MAX];
    size_t length = format_unsigned(text, decimal->digits);
    text[length++] = 'e';
    length += format_signed(text + length, decimal->exponent);
    struct parsed_number number;
    const unsigned char *at = (const unsigned char *)text;
    if (!parse_real(at, at + length, &number))
        return false;
    if (!precision->is_float32 || number.value == value)
        return number.value == value;
    double mirrored = 2 * number.value - value; /* exact: the two are near */
    return (double)(float)number.value == value && (double)(float)mirrored != mirrored;
}

/* The locale's decimal point, whatever it is, is passed over. */
static void shorten_by_library(const struct binary *number, const struct precision *precision,
                               struct decimal *out)
{
    int count = number->is_subnormal ? 1 : precision->sure_digits;
    for (; count <= precision->enough_digits; count++) {
        char text[64];
        snprintf(text, sizeof text, "%.*e", count - 1, number->value);
        uint64_t digits = 0;
        const char *at = text;
        for (; *at && *at != 'e'; at++)
            if (*at >= '0' && *at <= '9')
                digits = 10 * digits + (uint64_t)(*at - '0');
        int exponent = *at ? (int)strtol(at + 1, NULL, 10) : 0;
        *out = (struct decimal){digits, exponent - (count - 1)};
        if (gives_back(out, number->value, precision))
            break;
    }
    cut_zeros(out);
}

/* ---- the text ---- */

/* 1500 or 0.00015 as such, else 1.5e20. Zeros before the point are filled in only where the number
 * is that integer: a reader may take all digits before the point for significant. */
static char *put_decimal(char *to, struct decimal decimal, bool may_fill)
{
    enum { LEADING_ZEROS_MAX = 4 };
    int count = count_digits(decimal.digits);
    int point = count + decimal.exponent; /* digits before the point */
    if (decimal.exponent == 0 || (decimal.exponent > 0 && may_fill)) {
        to = put_digits(to, decimal.digits, count);
        memset(to, '0', (size_t)decimal.exponent);
        return to + decimal.exponent;
    }
    if (decimal.exponent < 0 && point > 0) {
        uint64_t ten = powers_of_ten[-decimal.exponent];
        to = put_digits(to, decimal.digits / ten, point);
        *to++ = '.';
        return put_digits(to, decimal.digits % ten, -decimal.exponent);
    }
    if (point <= 0 && point >= -LEADING_ZEROS_MAX) {
        to = put_text(to, "0.");
        memset(to, '0', (size_t)-point);
        return put_digits(to - point, decimal.digits, count);
    }
    uint64_t ten = powers_of_ten[count - 1];
    to = put_digits(to, decimal.digits / ten, 1);
    if (count > 1) {
        *to++ = '.';
        to = put_digits(to, decimal.digits % ten, count - 1);
    }
    *to++ = 'e';
    return to + format_signed(to, point - 1);
}

/* What is not a positive finite number, or the sign of a negative one. True when that was all. */
static bool put_special(char **to, double value)
{
    bool is_negative = signbit(value) != 0;
    if (isnan(value)) {
        *to = put_text(*to, "nan");
        return true;
    }
    if (is_negative)
        *(*to)++ = '-';
    if (isfinite(value) && value != 0)
        return false;
    *to = put_text(*to, value == 0 ? "0" : "inf");
    return true;
}

/* From the bits behind the sign. */
static void shorten(double value, uint64_t bits, const struct precision *precision,
                    struct binary *number, struct decimal *decimal)
{
    int fraction_bits = precision->mantissa_bits - 1;
    uint64_t hidden = 1ull << fraction_bits;
    uint64_t fraction = bits & (hidden - 1);
    int biased = (int)(bits >> fraction_bits);
    *number = (struct binary){.value = value,
                              .mantissa = biased ? fraction | hidden : fraction,
                              .exponent =
                                  (biased ? biased : 1) - precision->exponent_bias - fraction_bits,
                              .is_subnormal = biased == 0,
                              .is_narrow_below = fraction == 0 && biased > 1};
    if (!shorten_exactly(number, precision, decimal))
        shorten_by_library(number, precision, decimal);
}

size_t format_float32(char *to, float value)
{
    char *at = to;
    if (put_special(&at, (double)value))
        return (size_t)(at - to);
    value = fabsf(value);
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    struct binary number;
    struct decimal decimal = {0, 0};
    shorten((double)value, bits, &float_precision, &number, &decimal);
    return (size_t)(put_decimal(at, decimal, number.exponent <= 0) - to);
}

size_t format_double(char *to, double value, bool stays_double)
{
    char *at = to;
    if (put_special(&at, value))
        return (size_t)(at - to);
    value = fabs(value);
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    struct binary number;
    struct decimal decimal = {0, 0};
    shorten(value, bits, &double_precision, &number, &decimal);
    if (stays_double && (double)(float)value != value)
        while (float32_is_enough(value, decimal.exponent) && decimal.digits < UINT64_MAX / 20) {
            decimal.digits *= 10;
            decimal.exponent--;
        }
    return (size_t)(put_decimal(at, decimal, number.exponent <= 0) - to);
}

size_t format_unsigned(char *to, uint64_t value)
{
    int count = count_digits(value);
    put_digits(to, value, count);
    return (size_t)count;
}

size_t format_signed(char *to, int64_t value)
{
    if (value >= 0)
        return format_unsigned(to, (uint64_t)value);
    *to = '-';
    return 1 + format_unsigned(to + 1, -(uint64_t)value);
}
