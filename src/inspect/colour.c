/*
 * Viridis, by N. Smith and S. van der Walt (2015, dedicated to the public domain as CC0), is
 * defined by 256 colours. Eleven of them, evenly spaced, with a smooth curve through them (Catmull
 * & Rom 1974) are within a step or two of 255 of the whole table, which no eye can tell.
 */
#include "inspect/colour.h"

enum { KNOTS = 11 };

static const uint8_t knots[KNOTS][3] = {{0x44, 0x01, 0x54}, {0x48, 0x24, 0x75}, {0x41, 0x44, 0x87},
                                        {0x35, 0x5f, 0x8d}, {0x2a, 0x78, 0x8e}, {0x21, 0x91, 0x8c},
                                        {0x22, 0xa8, 0x84}, {0x44, 0xbf, 0x70}, {0x7a, 0xd1, 0x51},
                                        {0xbd, 0xdf, 0x26}, {0xfd, 0xe7, 0x25}};

static uint32_t to_byte(double value)
{
    return value <= 0 ? 0 : value >= 255 ? 255 : (uint32_t)(value + 0.5);
}

static uint32_t to_colour(double red, double green, double blue)
{
    return to_byte(red) << 16 | to_byte(green) << 8 | to_byte(blue);
}

uint32_t colour_map(double t)
{
    t = t > 0 ? t < 1 ? t : 1 : 0; /* NaN is 0 */
    double place = t * (KNOTS - 1);
    int i = place >= KNOTS - 1 ? KNOTS - 2 : (int)place;
    double s = place - i, channel[3];
    for (int k = 0; k < 3; k++) {
        double p1 = knots[i][k], p2 = knots[i + 1][k];
        double p0 = i > 0 ? knots[i - 1][k] : 2 * p1 - p2;
        double p3 = i + 2 < KNOTS ? knots[i + 2][k] : 2 * p2 - p1;
        double slope1 = (p2 - p0) / 2, slope2 = (p3 - p1) / 2, rise = p2 - p1;
        channel[k] =
            p1 +
            s * (slope1 + s * (3 * rise - 2 * slope1 - slope2 + s * (slope1 + slope2 - 2 * rise)));
    }
    return to_colour(channel[0], channel[1], channel[2]);
}

/* One channel of a hue in [0, 6): 1 for two sixths of the circle, 0 for two, ramps between. */
static double hue_channel(double hue)
{
    hue = hue < 0 ? hue + 6 : hue >= 6 ? hue - 6 : hue;
    double value = hue < 3 ? hue : 6 - hue; /* 3 in the middle of the channel's own side */
    value -= 1;
    return value < 0 ? 0 : value > 1 ? 1 : value;
}

uint32_t colour_distinct(uint32_t i)
{
    /* Steps of the golden angle never come near a hue again soon; three tones of each. */
    uint32_t turn = i * 2654435769u;
    double hue = (double)turn * (6.0 / 4294967296.0);
    uint32_t tone = (i * 2246822519u) >> 30;
    double strength = 0.34 + 0.08 * (double)(tone & 3), light = 0.97 - 0.07 * (double)(tone >> 1);
    double red = hue_channel(hue + 3), green = hue_channel(hue + 1), blue = hue_channel(hue + 5);
    return to_colour(255 * light * (1 - strength * (1 - red)),
                     255 * light * (1 - strength * (1 - green) * 0.85),
                     255 * light * (1 - strength * (1 - blue)));
}
