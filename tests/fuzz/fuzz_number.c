/*
 * Numbers in text against the C library's, in locale C: the same value to the last bit, and never a
 * byte looked at behind the end.
 */
#include "target.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/parse_number.h"

const bool target_keeps_length = false;

static void compare_real(const unsigned char *text, size_t size)
{
    struct parsed_number number;
    const unsigned char *stop = parse_real(text, text + size, &number);
    if (!stop)
        return;
    size_t length = (size_t)(stop - text);
    require(length >= 1 && length <= size && length <= NUMBER_LENGTH_MAX, "the length of a number");
    char copy[NUMBER_LENGTH_MAX + 1];
    memcpy(copy, text, length);
    copy[length] = '\0';
    char *end;
    double right = strtod(copy, &end);
    require(*end == '\0', "what is taken for a number is one");
    require(isnan(right) ? isnan(number.value)
                         : right == number.value && signbit(right) == signbit(number.value),
            "a number is rounded as the C library does");
    require(!number.is_integer || !strpbrk(copy, ".eE"), "an integer has no point");
    require(!number.fits_float32 || !isfinite(right) || right == 0 ||
                fabs((double)(float)right - right) <= fabs(right) ||
                !isfinite((double)(float)right),
            "a float32 that is enough is near");
}

static void compare_integer(const unsigned char *text, size_t size)
{
    int64_t value;
    const unsigned char *stop = parse_integer(text, text + size, &value);
    if (!stop)
        return;
    size_t length = (size_t)(stop - text);
    require(length >= 1 && length <= size, "the length of an integer");
    char copy[4096], *end;
    if (length >= sizeof copy)
        return;
    memcpy(copy, text, length);
    copy[length] = '\0';
    errno = 0;
    long long right = strtoll(copy, &end, 10);
    require(*end == '\0' && errno == 0 && right == value, "an integer is what the C library reads");
    uint32_t index;
    if (parse_index(text, text + size, &index) == stop)
        require(right == (long long)index, "an index is what the integer is");
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    compare_real(data, size);
    compare_integer(data, size);
    uint32_t index;
    const unsigned char *stop = parse_index(data, data + size, &index);
    require(!stop || (stop > data && stop <= data + size), "the length of an index");
    return 0;
}

void target_seeds(const struct seed_taker *taker)
{
    static const char *const texts[] = {"0",
                                        "-0.0",
                                        "+1",
                                        "123456789012345678901234567890",
                                        "0.1",
                                        "1e38",
                                        "1e-45",
                                        "4.9406564584124654e-324",
                                        "2.4703282292062327e-324",
                                        "1.7976931348623157e308",
                                        "1.7976931348623159e308",
                                        "9007199254740993",
                                        "9007199254740992.5000000000000000000000001",
                                        "1e99999999999999999999",
                                        "0e-99999999999999999999",
                                        "nan",
                                        "-inf",
                                        "Infinity",
                                        "1.5e+03 7",
                                        ".5",
                                        "5.",
                                        "1e",
                                        "4294967295",
                                        "4294967296",
                                        "-9223372036854775808",
                                        "9223372036854775808",
                                        "0x10",
                                        "1,5"};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        taker->take(taker->user, texts[i], strlen(texts[i]));
}
