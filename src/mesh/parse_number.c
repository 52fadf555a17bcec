/*
 * From decimal text to the nearest double.
 *
 * strtod is correctly rounded but follows the locale, wants a NUL behind the text and takes 50 to
 * 200 nanoseconds; adding digits up in floating point is fast and wrong in the last place. Here:
 *
 *   1. Digits are gathered into a 64-bit integer w, eight at a time where eight are there, so that
 *      the number is w * 10^q. In the usual number, a few digits, a point, a few digits, no loop
 *      and no branch asks how many there are: up to eight are taken by one shift.
 *   2. When w is below 2^53 and |q| at most 22, both are exact doubles and one multiplication or
 *      division rounds correctly (Clinger 1990). Nearly all coordinates end here.
 *   3. Else, for up to 19 digits and |q| up to 64, w is multiplied with 128 bits of 5^q; the upper
 *      bits of the product decide the rounding unless they lie too near a tie, which is noticed
 *      (Eisel and Lemire; Lemire 2021, "Number parsing at a gigabyte per second").
 *   4. What remains goes to strtod_l with the C locale.
 *
 * parse_number's tests compare all of it with strtod on millions of texts.
 */
#include "mesh/parse_number.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"

enum { FIRST_POWER = -64, LAST_POWER = 63, EXACT_POWERS = 22, DIGITS_MAX = 19 };

/* A short number: a sign, so many digits, a point, eight digits, and up to seven more where the
 * first are few enough that 64 bits hold all. */
enum { SHORT_WHOLE = 7, LONG_WHOLE = 4, SHORT_BYTES = 1 + SHORT_WHOLE + 1 + 8 + 8 };

/* 5^q for q from -64 to 63, as 128 bits with the highest one set; for negative q rounded up, else
 * down (all up to 5^55 are exact). */
static const struct {
    uint64_t high, low;
} powers_of_five[] = {
    {0xa87fea27a539e9a5, 0x3f2398d747b36225}, {0xd29fe4b18e88640e, 0x8eec7f0d19a03aae},
    {0x83a3eeeef9153e89, 0x1953cf68300424ad}, {0xa48ceaaab75a8e2b, 0x5fa8c3423c052dd8},
    {0xcdb02555653131b6, 0x3792f412cb06794e}, {0x808e17555f3ebf11, 0xe2bbd88bbee40bd1},
    {0xa0b19d2ab70e6ed6, 0x5b6aceaeae9d0ec5}, {0xc8de047564d20a8b, 0xf245825a5a445276},
    {0xfb158592be068d2e, 0xeed6e2f0f0d56713}, {0x9ced737bb6c4183d, 0x55464dd69685606c},
    {0xc428d05aa4751e4c, 0xaa97e14c3c26b887}, {0xf53304714d9265df, 0xd53dd99f4b3066a9},
    {0x993fe2c6d07b7fab, 0xe546a8038efe402a}, {0xbf8fdb78849a5f96, 0xde98520472bdd034},
    {0xef73d256a5c0f77c, 0x963e66858f6d4441}, {0x95a8637627989aad, 0xdde7001379a44aa9},
    {0xbb127c53b17ec159, 0x5560c018580d5d53}, {0xe9d71b689dde71af, 0xaab8f01e6e10b4a7},
    {0x9226712162ab070d, 0xcab3961304ca70e9}, {0xb6b00d69bb55c8d1, 0x3d607b97c5fd0d23},
    {0xe45c10c42a2b3b05, 0x8cb89a7db77c506b}, {0x8eb98a7a9a5b04e3, 0x77f3608e92adb243},
    {0xb267ed1940f1c61c, 0x55f038b237591ed4}, {0xdf01e85f912e37a3, 0x6b6c46dec52f6689},
    {0x8b61313bbabce2c6, 0x2323ac4b3b3da016}, {0xae397d8aa96c1b77, 0xabec975e0a0d081b},
    {0xd9c7dced53c72255, 0x96e7bd358c904a22}, {0x881cea14545c7575, 0x7e50d64177da2e55},
    {0xaa242499697392d2, 0xdde50bd1d5d0b9ea}, {0xd4ad2dbfc3d07787, 0x955e4ec64b44e865},
    {0x84ec3c97da624ab4, 0xbd5af13bef0b113f}, {0xa6274bbdd0fadd61, 0xecb1ad8aeacdd58f},
    {0xcfb11ead453994ba, 0x67de18eda5814af3}, {0x81ceb32c4b43fcf4, 0x80eacf948770ced8},
    {0xa2425ff75e14fc31, 0xa1258379a94d028e}, {0xcad2f7f5359a3b3e, 0x096ee45813a04331},
    {0xfd87b5f28300ca0d, 0x8bca9d6e188853fd}, {0x9e74d1b791e07e48, 0x775ea264cf55347e},
    {0xc612062576589dda, 0x95364afe032a819e}, {0xf79687aed3eec551, 0x3a83ddbd83f52205},
    {0x9abe14cd44753b52, 0xc4926a9672793543}, {0xc16d9a0095928a27, 0x75b7053c0f178294},
    {0xf1c90080baf72cb1, 0x5324c68b12dd6339}, {0x971da05074da7bee, 0xd3f6fc16ebca5e04},
    {0xbce5086492111aea, 0x88f4bb1ca6bcf585}, {0xec1e4a7db69561a5, 0x2b31e9e3d06c32e6},
    {0x9392ee8e921d5d07, 0x3aff322e62439fd0}, {0xb877aa3236a4b449, 0x09befeb9fad487c3},
    {0xe69594bec44de15b, 0x4c2ebe687989a9b4}, {0x901d7cf73ab0acd9, 0x0f9d37014bf60a11},
    {0xb424dc35095cd80f, 0x538484c19ef38c95}, {0xe12e13424bb40e13, 0x2865a5f206b06fba},
    {0x8cbccc096f5088cb, 0xf93f87b7442e45d4}, {0xafebff0bcb24aafe, 0xf78f69a51539d749},
    {0xdbe6fecebdedd5be, 0xb573440e5a884d1c}, {0x89705f4136b4a597, 0x31680a88f8953031},
    {0xabcc77118461cefc, 0xfdc20d2b36ba7c3e}, {0xd6bf94d5e57a42bc, 0x3d32907604691b4d},
    {0x8637bd05af6c69b5, 0xa63f9a49c2c1b110}, {0xa7c5ac471b478423, 0x0fcf80dc33721d54},
    {0xd1b71758e219652b, 0xd3c36113404ea4a9}, {0x83126e978d4fdf3b, 0x645a1cac083126ea},
    {0xa3d70a3d70a3d70a, 0x3d70a3d70a3d70a4}, {0xcccccccccccccccc, 0xcccccccccccccccd},
    {0x8000000000000000, 0x0000000000000000}, {0xa000000000000000, 0x0000000000000000},
    {0xc800000000000000, 0x0000000000000000}, {0xfa00000000000000, 0x0000000000000000},
    {0x9c40000000000000, 0x0000000000000000}, {0xc350000000000000, 0x0000000000000000},
    {0xf424000000000000, 0x0000000000000000}, {0x9896800000000000, 0x0000000000000000},
    {0xbebc200000000000, 0x0000000000000000}, {0xee6b280000000000, 0x0000000000000000},
    {0x9502f90000000000, 0x0000000000000000}, {0xba43b74000000000, 0x0000000000000000},
    {0xe8d4a51000000000, 0x0000000000000000}, {0x9184e72a00000000, 0x0000000000000000},
    {0xb5e620f480000000, 0x0000000000000000}, {0xe35fa931a0000000, 0x0000000000000000},
    {0x8e1bc9bf04000000, 0x0000000000000000}, {0xb1a2bc2ec5000000, 0x0000000000000000},
    {0xde0b6b3a76400000, 0x0000000000000000}, {0x8ac7230489e80000, 0x0000000000000000},
    {0xad78ebc5ac620000, 0x0000000000000000}, {0xd8d726b7177a8000, 0x0000000000000000},
    {0x878678326eac9000, 0x0000000000000000}, {0xa968163f0a57b400, 0x0000000000000000},
    {0xd3c21bcecceda100, 0x0000000000000000}, {0x84595161401484a0, 0x0000000000000000},
    {0xa56fa5b99019a5c8, 0x0000000000000000}, {0xcecb8f27f4200f3a, 0x0000000000000000},
    {0x813f3978f8940984, 0x4000000000000000}, {0xa18f07d736b90be5, 0x5000000000000000},
    {0xc9f2c9cd04674ede, 0xa400000000000000}, {0xfc6f7c4045812296, 0x4d00000000000000},
    {0x9dc5ada82b70b59d, 0xf020000000000000}, {0xc5371912364ce305, 0x6c28000000000000},
    {0xf684df56c3e01bc6, 0xc732000000000000}, {0x9a130b963a6c115c, 0x3c7f400000000000},
    {0xc097ce7bc90715b3, 0x4b9f100000000000}, {0xf0bdc21abb48db20, 0x1e86d40000000000},
    {0x96769950b50d88f4, 0x1314448000000000}, {0xbc143fa4e250eb31, 0x17d955a000000000},
    {0xeb194f8e1ae525fd, 0x5dcfab0800000000}, {0x92efd1b8d0cf37be, 0x5aa1cae500000000},
    {0xb7abc627050305ad, 0xf14a3d9e40000000}, {0xe596b7b0c643c719, 0x6d9ccd05d0000000},
    {0x8f7e32ce7bea5c6f, 0xe4820023a2000000}, {0xb35dbf821ae4f38b, 0xdda2802c8a800000},
    {0xe0352f62a19e306e, 0xd50b2037ad200000}, {0x8c213d9da502de45, 0x4526f422cc340000},
    {0xaf298d050e4395d6, 0x9670b12b7f410000}, {0xdaf3f04651d47b4c, 0x3c0cdd765f114000},
    {0x88d8762bf324cd0f, 0xa5880a69fb6ac800}, {0xab0e93b6efee0053, 0x8eea0d047a457a00},
    {0xd5d238a4abe98068, 0x72a4904598d6d880}, {0x85a36366eb71f041, 0x47a6da2b7f864750},
    {0xa70c3c40a64e6c51, 0x999090b65f67d924}, {0xd0cf4b50cfe20765, 0xfff4b4e3f741cf6d},
    {0x82818f1281ed449f, 0xbff8f10e7a8921a4}, {0xa321f2d7226895c7, 0xaff72d52192b6a0d},
    {0xcbea6f8ceb02bb39, 0x9bf4f8a69f764490}, {0xfee50b7025c36a08, 0x02f236d04753d5b4},
    {0x9f4f2726179a2245, 0x01d762422c946590}, {0xc722f0ef9d80aad6, 0x424d3ad2b7b97ef5},
    {0xf8ebad2b84e0d58b, 0xd2e0898765a7deb2}, {0x9b934c3b330c8577, 0x63cc55f49f88eb2f}};

static const double tenths[] = {1e-0,  1e-1,  1e-2,  1e-3,  1e-4,  1e-5,  1e-6,  1e-7,
                                1e-8,  1e-9,  1e-10, 1e-11, 1e-12, 1e-13, 1e-14, 1e-15,
                                1e-16, 1e-17, 1e-18, 1e-19, 1e-20, 1e-21, 1e-22};
static const double powers_of_ten[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                       1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                       1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

static bool is_digit(unsigned char c)
{
    return (unsigned char)(c - '0') < 10;
}

/* ---- gathering digits ---- */

/* Appends digits to *w, which may overflow: callers count the digits. */
static const unsigned char *gather_digits(const unsigned char *at, const unsigned char *end,
                                          uint64_t *w)
{
    uint64_t sum = *w;
    while (end - at >= 8) {
        uint64_t bytes = load_u64(at);
        if (digits_in_front(bytes) < 8)
            break;
        sum = sum * 100000000 + value_of_digits(bytes, 8);
        at += 8;
    }
    for (; at < end && is_digit(*at); at++)
        sum = 10 * sum + (unsigned char)(*at - '0');
    *w = sum;
    return at;
}

/* ---- rounding ---- */

/* The double with these 53 bits, times 2^(exponent - 1075); a normal number. */
static double compose(uint64_t mantissa, int64_t exponent)
{
    uint64_t bits = (mantissa & 0xfffffffffffffu) | (uint64_t)exponent << 52;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/*
 * w * 10^q for w > 0 and q within the table. False when the bits do not decide.
 *
 * w, shifted to fill 64 bits, times the 64 upper bits of 5^q gives 128 bits that are at most one
 * unit of w too small in their upper half; the lower bits of 5^q are used when this could carry
 * into the 55 bits that are kept (53, one to round by, one for the shift).
 */
static bool round_product(uint64_t w, int q, double *value)
{
    int shift = __builtin_clzll(w);
    uint64_t high_power = powers_of_five[q - FIRST_POWER].high;
    uint64_t low_power = powers_of_five[q - FIRST_POWER].low;
    w <<= shift;
    unsigned __int128 product = (unsigned __int128)w * high_power;
    if (((uint64_t)(product >> 64) & 0x1ff) == 0x1ff)
        product += (unsigned __int128)w * low_power >> 64;
    uint64_t high = (uint64_t)(product >> 64), low = (uint64_t)product;

    int upper_bit = (int)(high >> 63);
    uint64_t mantissa = high >> (upper_bit + 9);
    uint64_t dropped = high & ((1ull << (upper_bit + 9)) - 1);
    /* All bits below are ones: the true product may be larger and carry. */
    if (low == UINT64_MAX && dropped == (1ull << (upper_bit + 9)) - 1)
        return false;
    /* A tie, or so near one that the product's error matters. */
    if ((mantissa & 1) && dropped == 0 && low <= 1)
        return false;
    mantissa += mantissa & 1;
    mantissa >>= 1;
    /* floor(q * log2(5)) + q + 63 is the exponent of the highest bit of the shifted product. */
    int64_t exponent = ((int64_t)q * (152170 + 65536) >> 16) + 63 + upper_bit - shift + 1023;
    if (mantissa >> 53) {
        mantissa >>= 1;
        exponent++;
    }
    *value = compose(mantissa, exponent);
    return true;
}

/* The general road, with a copy of the text. */
static bool round_by_library(const unsigned char *text, size_t length, double *value)
{
    char copy[NUMBER_LENGTH_MAX + 1];
    memcpy(copy, text, length);
    copy[length] = 0;
    locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0); /* glibc: a constant, no memory */
    if (!c_locale)
        return false;
    char *stop;
    *value = strtod_l(copy, &stop, c_locale);
    freelocale(c_locale);
    return stop == copy + length;
}

/* ---- the rule for float32 ---- */

/* 10^q in double, which need not be exact: the rule is about half a unit of the last decimal, and
 * differences are never so near to that. 0 far below all doubles. */
static double unit_of(int64_t q)
{
    if (q >= 0)
        return q <= EXACT_POWERS ? powers_of_ten[q] : (double)INFINITY;
    if (q >= -EXACT_POWERS)
        return tenths[-q];
    double unit = 1;
    for (; q < -EXACT_POWERS && unit > 0; q += EXACT_POWERS)
        unit /= powers_of_ten[EXACT_POWERS];
    return q < -EXACT_POWERS ? 0 : unit / powers_of_ten[-q];
}

bool float32_is_enough(double value, int64_t exponent)
{
    double half = 0.5 * unit_of(exponent);
    /* A text may lie exactly half a unit from the float that it was printed from; then the rounding
     * of the text to a double must not decide. */
    double slack = fabs(value) * 0x1p-53;
    slack = slack < half * 0x1p-10 ? slack : half * 0x1p-10;
    double off = fabs((double)(float)value - value);
    return off <= half + slack && off < (double)INFINITY;
}

/* ---- the whole ---- */

static bool begins_with(const unsigned char *at, const unsigned char *end, const char *word)
{
    for (; *word; word++, at++)
        if (at >= end || (*at | 0x20) != *word)
            return false;
    return true;
}

static const unsigned char *parse_not_finite(const unsigned char *at, const unsigned char *end,
                                             bool is_negative, struct parsed_number *number)
{
    static const char *const words[] = {"infinity", "inf", "nan"};
    for (unsigned i = 0; i < 3; i++)
        if (begins_with(at, end, words[i])) {
            double value = i < 2 ? (double)INFINITY : (double)NAN;
            *number = (struct parsed_number){is_negative ? -value : value, false, false};
            return at + strlen(words[i]);
        }
    return NULL;
}

/* The exponent behind `e`, in *q; NULL when there is none. Absurd ones are cut, not refused. */
static const unsigned char *parse_exponent(const unsigned char *at, const unsigned char *end,
                                           int64_t *q)
{
    bool is_negative = at < end && *at == '-';
    if (at < end && (*at == '-' || *at == '+'))
        at++;
    if (at == end || !is_digit(*at))
        return NULL;
    int64_t exponent = 0;
    for (; at < end && is_digit(*at); at++)
        if (exponent < 100000)
            exponent = 10 * exponent + (*at - '0');
    *q += is_negative ? -exponent : exponent;
    return at;
}

/* More digits than w can hold: those in front that are zero do not count. */
static bool are_too_many(const unsigned char *first, const unsigned char *end)
{
    size_t digits = 0;
    for (; first < end; first++)
        digits += is_digit(*first) && (digits > 0 || *first != '0');
    return digits > DIGITS_MAX;
}

/* Not inlined: what it saves and restores would be the quick way's too. */
__attribute__((noinline)) static const unsigned char *
parse_any_real(const unsigned char *at, const unsigned char *end, struct parsed_number *number)
{
    const unsigned char *start = at;
    bool is_negative = at < end && *at == '-';
    if (at < end && (*at == '-' || *at == '+'))
        at++;
    uint64_t w = 0;
    int64_t q = 0;
    const unsigned char *first = at;
    at = gather_digits(at, end, &w);
    ptrdiff_t digits = at - first;
    if (at < end && *at == '.') {
        const unsigned char *fraction = ++at;
        at = gather_digits(at, end, &w);
        q = fraction - at;
        digits += at - fraction;
    }
    if (digits == 0)
        return at == first ? parse_not_finite(at, end, is_negative, number) : NULL;
    const unsigned char *digits_end = at;
    number->is_integer = q == 0 && at[-1] != '.';
    if (at < end && (*at | 0x20) == 'e') {
        at = parse_exponent(at + 1, end, &q);
        if (!at)
            return NULL;
        number->is_integer = false;
    }

    if (at - start > NUMBER_LENGTH_MAX)
        return NULL;
    bool is_cut = digits > DIGITS_MAX && are_too_many(first, digits_end);
    double value;
    if (!is_cut && w < 1ull << 53 && q >= -EXACT_POWERS && q <= EXACT_POWERS) {
        value = q < 0 ? (double)w / powers_of_ten[-q] : (double)w * powers_of_ten[q];
        value = is_negative ? -value : value;
    } else if (!is_cut && w > 0 && q >= FIRST_POWER && q <= LAST_POWER &&
               round_product(w, (int)q, &value)) {
        value = is_negative ? -value : value;
    } else if (!round_by_library(start, (size_t)(at - start), &value)) {
        return NULL;
    }
    number->value = value;
    number->fits_float32 = float32_is_enough(value, q);
    return at;
}

/* [-] digits . digits, few and without an exponent, as nearly all coordinates are; NULL for all
 * else. Looks at SHORT_BYTES. */
static inline const unsigned char *parse_short(const unsigned char *at,
                                               struct parsed_number *number)
{
    static const uint32_t powers[] = {1,      10,      100,      1000,     10000,
                                      100000, 1000000, 10000000, 100000000};
    const bool is_negative = *at == '-';
    at += is_negative;
    unsigned whole = 1;
    uint64_t bytes, w = (unsigned char)(*at - '0');
    if (w > 9 || at[1] != '.') {
        bytes = load_u64(at);
        whole = digits_in_front(bytes);
        if (whole == 0 || whole > SHORT_WHOLE || at[whole] != '.')
            return NULL;
        w = value_of_digits(bytes, whole);
    }
    at += whole + 1;
    bytes = load_u64(at);
    unsigned decimals = digits_in_front(bytes);
    if (decimals == 0)
        return NULL;
    w = w * powers[decimals] + value_of_digits(bytes, decimals);
    at += decimals;
    if (decimals == 8) {
        bytes = load_u64(at);
        const unsigned more = digits_in_front(bytes);
        if (more == 8 || whole > LONG_WHOLE)
            return NULL;
        if (more > 0)
            w = w * powers[more] + value_of_digits(bytes, more);
        at += more;
        decimals += more;
    }
    if (w >= 1ull << 53 || (*at | 0x20) == 'e')
        return NULL;
    const double value = (double)w / powers_of_ten[decimals];
    number->value = is_negative ? -value : value;
    /* A float32 is off by at most 2^-24 of the value, in units of the last decimal w * 2^-24. */
    number->fits_float32 = w < 1u << 23 || float32_is_enough(value, -(int64_t)decimals);
    number->is_integer = false;
    return at;
}

const unsigned char *parse_real(const unsigned char *at, const unsigned char *end,
                                struct parsed_number *number)
{
    const unsigned char *stop = end - at >= SHORT_BYTES ? parse_short(at, number) : NULL;
    return stop ? stop : parse_any_real(at, end, number);
}

const unsigned char *parse_integer(const unsigned char *at, const unsigned char *end,
                                   int64_t *value)
{
    bool is_negative = at < end && *at == '-';
    if (at < end && (*at == '-' || *at == '+'))
        at++;
    const unsigned char *first = at;
    uint64_t sum = 0;
    for (; at < end && is_digit(*at); at++) {
        if (sum > (uint64_t)INT64_MAX / 10 - 1)
            return NULL;
        sum = 10 * sum + (unsigned char)(*at - '0');
    }
    *value = is_negative ? -(int64_t)sum : (int64_t)sum;
    return at == first ? NULL : at;
}
