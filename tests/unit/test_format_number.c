/*
 * Numbers as text: random and extreme ones are given back by the C library and by our reader, and
 * no fewer digits would do.
 */
#include "test_kit.h"

#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/format_number.h"
#include "mesh/parse_number.h"
#include "test_shapes.h"

static bool same_double(double a, double b)
{
    return memcmp(&a, &b, sizeof a) == 0;
}

/* Digits from the first to the last that is not zero, leaving out what follows an e. */
static size_t significant(const char *text)
{
    size_t count = 0, zeros = 0;
    for (; *text && *text != 'e'; text++) {
        if (*text < '0' || *text > '9')
            continue;
        if (*text != '0') {
            count += zeros + 1;
            zeros = 0;
        } else if (count > 0) {
            zeros++;
        }
    }
    return count > 0 ? count : 1;
}

/* As our own readers take the text. */
static void check_parsed(const char *text, size_t length, double value, bool fits_float32)
{
    struct parsed_number number;
    const unsigned char *at = (const unsigned char *)text;
    const unsigned char *end = parse_real(at, at + length, &number);
    if (end != at + length || number.fits_float32 != fits_float32 ||
        !same_double(fits_float32 ? (double)(float)number.value : number.value, value))
        fail_msg("%s is not read as the %s %a", text, fits_float32 ? "float" : "double", value);
}

static void check_double(double value)
{
    char text[64], other[64];
    size_t length = format_double(text, value, false);
    assert_in_range(length, 1, NUMBER_TEXT_MAX);
    text[length] = 0;
    if (!same_double(strtod(text, NULL), value))
        fail_msg("%s is not %a", text, value);
    for (int digits = 1; digits <= 17; digits++) {
        snprintf(other, sizeof other, "%.*g", digits, value);
        if (strtod(other, NULL) == value)
            break;
    }
    if (significant(text) > significant(other))
        fail_msg("%s is longer than %s", text, other);
}

static void check_float(float value)
{
    char text[64], other[64];
    size_t length = format_float32(text, value);
    assert_in_range(length, 1, NUMBER_TEXT_MAX);
    text[length] = 0;
    /* Read as a float, or as a double and then rounded. */
    if (!same_double((double)strtof(text, NULL), (double)value) ||
        !same_double((double)(float)strtod(text, NULL), (double)value))
        fail_msg("%s is not %a", text, (double)value);
    check_parsed(text, length, (double)value, true);
    for (int digits = 1; digits <= 9; digits++) {
        snprintf(other, sizeof other, "%.*g", digits, (double)value);
        if (strtof(other, NULL) == value)
            break;
    }
    if (significant(text) > significant(other))
        fail_msg("%s is longer than %s", text, other);
}

/* Text of a double that a reader who guesses the type does not take for a float. */
static void check_lasting(double value)
{
    char text[64];
    size_t length = format_double(text, value, true);
    assert_in_range(length, 1, NUMBER_TEXT_MAX);
    text[length] = 0;
    check_parsed(text, length, value, (double)(float)value == value);
}

static void check_both(double value)
{
    check_double(value);
    check_lasting(value);
    if (fabs(value) <= (double)0x1.fffffep127f)
        check_float((float)value);
}

static void test_numbers_give_back(void **state)
{
    (void)state;
    uint64_t seed = 20261122;
    for (int i = 0; i < 30000; i++) {
        uint64_t bits = random_next(&seed);
        double value;
        memcpy(&value, &bits, sizeof value);
        if (isfinite(value)) /* of any size */
            check_double(value);
        uint32_t half = (uint32_t)(bits >> 20);
        float narrow;
        memcpy(&narrow, &half, sizeof narrow);
        if (isfinite(narrow))
            check_float(narrow);
        check_both(ldexp((double)(int64_t)random_next(&seed), -(int)(random_next(&seed) % 90)));
        check_both((double)(int64_t)(random_next(&seed) % 2000001) / 1000 - 1000); /* millimetres */
        check_both((double)(random_next(&seed) >> (random_next(&seed) % 64)) / 4); /* ties */
        half &= 0x807fffff;                                                        /* subnormal */
        memcpy(&narrow, &half, sizeof narrow);
        check_float(narrow);
    }
    for (int exponent = -1074; exponent < 1024; exponent++) {
        double power = ldexp(1, exponent);
        check_both(power);
        check_both(-nextafter(power, 0));
        check_both(nextafter(power, INFINITY));
        check_float(nextafterf((float)ldexp(1, exponent / 8), 0));
    }
    for (int exponent = -323; exponent <= 308; exponent++) {
        char text[16];
        snprintf(text, sizeof text, "1e%d", exponent);
        check_both(strtod(text, NULL));
        check_double(nextafter(strtod(text, NULL), 0));
    }
}

static void check_text(size_t (*format)(char *to, double value), double value, const char *expected)
{
    char text[64];
    text[format(text, value)] = 0;
    assert_string_equal(text, expected);
}

static size_t format_narrow(char *to, double value)
{
    return format_float32(to, (float)value);
}

static size_t format_wide(char *to, double value)
{
    return format_double(to, value, false);
}

/* For a reader that takes 0.1 for the float32 of that name. */
static size_t format_lasting(char *to, double value)
{
    return format_double(to, value, true);
}

static void test_number_texts(void **state)
{
    (void)state;
    check_text(format_narrow, 0, "0");
    check_text(format_narrow, -0.0, "-0");
    check_text(format_narrow, 0.1, "0.1");
    check_text(format_narrow, -1500, "-1500");
    check_text(format_narrow, 0.00015, "0.00015");
    check_text(format_narrow, 1.5e-7, "1.5e-7");
    check_text(format_narrow, 16777216, "16777216");
    /* 123456792: zeros behind its nine digits would claim what a float does not hold. */
    check_text(format_narrow, 12345678912345.0, "1.2345679e13");
    check_text(format_narrow, (double)INFINITY, "inf");
    check_text(format_narrow, (double)-INFINITY, "-inf");
    check_text(format_narrow, (double)NAN, "nan");
    check_text(format_wide, 0.1, "0.1");
    check_text(format_wide, 0.1 + 0.2, "0.30000000000000004");
    check_text(format_wide, 9007199254740992, "9007199254740992");
    check_text(format_wide, 4503599627370496, "4503599627370496");
    check_text(format_wide, 432100.125, "432100.125");
    check_text(format_wide, 1e22, "1e22");
    check_text(format_wide, 5e-324, "5e-324");
    check_text(format_wide, (double)-INFINITY, "-inf");
    check_text(format_lasting, 0.1, "0.100000000");
    check_text(format_lasting, 0.5, "0.5");
    check_text(format_lasting, 4321001.2, "4321001.2");
    check_text(format_lasting, 4321001, "4321001");

    char text[64];
    text[format_unsigned(text, 0)] = 0;
    assert_string_equal(text, "0");
    text[format_unsigned(text, UINT64_MAX)] = 0;
    assert_string_equal(text, "18446744073709551615");
    text[format_signed(text, INT64_MIN)] = 0;
    assert_string_equal(text, "-9223372036854775808");
    for (uint64_t power = 1, i = 0; i < 20; i++, power *= 10)
        for (uint64_t value = power - 1; value <= power + 1; value++) {
            char expected[64];
            snprintf(expected, sizeof expected, "%llu", (unsigned long long)value);
            text[format_unsigned(text, value)] = 0;
            assert_string_equal(text, expected);
        }
}

static void test_numbers_ignore_the_locale(void **state)
{
    (void)state;
    static const char *const commas[] = {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "de_DE"};
    const char *found = NULL;
    for (unsigned i = 0; i < 4 && !found; i++)
        found = setlocale(LC_ALL, commas[i]);
    if (!found)
        skip();
    char ordinary[64], tiny[64];
    ordinary[format_double(ordinary, 1.5, false)] = 0;
    tiny[format_double(tiny, 1.25e-300, false)] = 0;
    setlocale(LC_ALL, "C");
    assert_string_equal(ordinary, "1.5");
    assert_string_equal(tiny, "1.25e-300");
}

static void test_every_colour_comes_back_from_obj(void **state)
{
    (void)state;
    for (unsigned byte = 0; byte < 256; byte++) {
        char text[64];
        text[format_float32(text, (float)byte / 255.0f)] = 0;
        assert_int_equal((unsigned)(strtod(text, NULL) * 255 + 0.5), byte);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_numbers_give_back),
        cmocka_unit_test(test_number_texts),
        cmocka_unit_test(test_numbers_ignore_the_locale),
        cmocka_unit_test(test_every_colour_comes_back_from_obj),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
