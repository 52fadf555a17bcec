/*
 * Letters as strokes. A bitmap face has one size and looks like steps at any other; outlines need
 * filling rules and many points. A stroke is a polyline drawn with a round pen: a few digits a
 * letter are enough, and the distance from the polyline gives smooth edges at any size.
 *
 * A glyph is a list of strokes between spaces: `-` straight lines, `~` a curve from its first to
 * its last point, `o` a closed curve, `.` a dot; then pairs of digits x, y. The baseline is y = 2,
 * small letters reach 6, capitals 8. Curves are made from their control points by cutting corners
 * (Chaikin, "An algorithm for high speed curve generation", 1974).
 */
#include "inspect/font.h"

#include <math.h>
#include <string.h>

enum { POINTS_MAX = 256, CHAIKIN_ROUNDS = 3 };

static const double baseline = 2, capital = 6, pen_radius = 0.47, gap = 1.9, space = 2.6;

static const char *const glyphs[95] = {
    "",                                  /* space */
    "-0804 .02",                         /* ! */
    "-0806 -2826",                       /* " */
    "-1218 -3238 -0444 -0646",           /* # */
    "~47480805454202030302 -2921",       /* $ */
    "o06262808 o32525434 -0258",         /* % */
    "~420608282604022244",               /* & */
    "-0806",                             /* ' */
    "~19070311",                         /* ( */
    "~09171301",                         /* ) */
    "-2824 -0745 -0547",                 /* * */
    "-2226 -0444",                       /* + */
    "-1201",                             /* , */
    "-0434",                             /* - */
    ".02",                               /* . */
    "-0139",                             /* / */
    "o02424808",                         /* 0 */
    "-072822 -0242",                     /* 1 */
    "~0608484502 -0242",                 /* 2 */
    "~0708484525 ~2545420203",           /* 3 */
    "-380444 -3832",                     /* 4 */
    "-480805 ~0516464202",               /* 5 */
    "o02424606 ~480804",                 /* 6 */
    "-084812",                           /* 7 */
    "o05454808 o02424505",               /* 8 */
    "o04444808 ~464202",                 /* 9 */
    ".02 .05",                           /* : */
    ".15 -1201",                         /* ; */
    "-360432",                           /* < */
    "-0535 -0333",                       /* = */
    "-063402",                           /* > */
    "~070848452524 .22",                 /* ? */
    "o23434626 ~4643636808 ~08020252",   /* @ */
    "-022842 -1434",                     /* A */
    "-080205 -0802 ~08484505 ~05454202", /* B */
    "~474808024243",                     /* C */
    "-0208 ~08484202",                   /* D */
    "-48080242 -0535",                   /* E */
    "-480802 -0535",                     /* F */
    "~474808024245 -4525",               /* G */
    "-0208 -4248 -0545",                 /* H */
    "-0208",                             /* I */
    "~48420203",                         /* J */
    "-0208 -4804 -1542",                 /* K */
    "-080242",                           /* L */
    "-0208346862",                       /* M */
    "-02084248",                         /* N */
    "o02525808",                         /* O */
    "-0208 ~08484404",                   /* P */
    "o02525808 -3452",                   /* Q */
    "-0208 ~08484404 -2442",             /* R */
    "~474808054545420203",               /* S */
    "-0848 -2822",                       /* T */
    "~08024248",                         /* U */
    "-082248",                           /* V */
    "-0812365268",                       /* W */
    "-0248 -0842",                       /* X */
    "-082548 -2522",                     /* Y */
    "-08480242",                         /* Z */
    "-29090121",                         /* [ */
    "-0931",                             /* \ */
    "-09292101",                         /* ] */
    "-062846",                           /* ^ */
    "-0141",                             /* _ */
    "-0817",                             /* ` */
    "o02323606 -3632",                   /* a */
    "-0802 o02323606",                   /* b */
    "~353606023233",                     /* c */
    "-3832 o02323606",                   /* d */
    "-0434 ~343606023233",               /* e */
    "~381812 -0626",                     /* f */
    "o02323606 ~36300001",               /* g */
    "-0802 ~04063632",                   /* h */
    "-0206 .08",                         /* i */
    "~161000 .18",                       /* j */
    "-0802 -3603 -1432",                 /* k */
    "~080212",                           /* l */
    "-0602 ~04063632 ~34366662",         /* m */
    "-0602 ~04063632",                   /* n */
    "o02323606",                         /* o */
    "-0600 o02323606",                   /* p */
    "-3630 o02323606",                   /* q */
    "-0602 ~040626",                     /* r */
    "~353606043434320203",               /* s */
    "~181232 -0626",                     /* t */
    "~06023234 -3632",                   /* u */
    "-062246",                           /* v */
    "-0612355266",                       /* w */
    "-0236 -0632",                       /* x */
    "-0622 -4610",                       /* y */
    "-06360232",                         /* z */
    "~29191505 ~05151121",               /* { */
    "-0901",                             /* | */
    "~09191525 ~25151101",               /* } */
    "~04153345",                         /* ~ */
};

struct point {
    double x, y;
};

static const char *glyph_of(char letter)
{
    return letter >= 32 && letter < 127 ? glyphs[letter - 32] : glyphs['?' - 32];
}

/* In glyph units, without the gap behind it. */
static double glyph_width(char letter)
{
    double width = letter == ' ' ? space : 0;
    const char *glyph = glyph_of(letter);
    for (const char *at = glyph; *at; at++) {
        if (*at < '0' || *at > '9')
            continue;
        width = fmax(width, *at - '0');
        at++; /* y */
    }
    return width;
}

double text_width(const char *text, double size)
{
    double width = 0;
    for (const char *at = text; *at; at++)
        width += glyph_width(*at) + gap;
    return *text ? (width - gap + 2 * pen_radius) * size / capital : 0;
}

/* Reads a stroke's points; returns how many. *kind is its first character. */
static size_t read_stroke(const char **glyph, char *kind, struct point *points)
{
    const char *at = *glyph;
    size_t count = 0;
    while (*at == ' ')
        at++;
    if (!*at)
        return 0;
    *kind = *at++;
    for (; *at && *at != ' '; at += 2)
        points[count++] = (struct point){at[0] - '0', at[1] - '0'};
    *glyph = at;
    return count;
}

static struct point between(struct point a, struct point b, double t)
{
    return (struct point){a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
}

/* Cuts the corners of a polyline once, or of a closed polygon whose first point is not repeated. */
static size_t cut_corners(struct point *points, size_t count, bool closed)
{
    struct point cut[POINTS_MAX];
    size_t used = 0, edges = closed ? count : count - 1;
    if (2 * edges + 2 > POINTS_MAX)
        return count;
    if (!closed)
        cut[used++] = points[0];
    for (size_t i = 0; i < edges; i++) {
        struct point a = points[i], b = points[(i + 1) % count];
        if (closed || i > 0)
            cut[used++] = between(a, b, 0.25);
        if (closed || i + 1 < edges)
            cut[used++] = between(a, b, 0.75);
    }
    if (!closed)
        cut[used++] = points[count - 1];
    memcpy(points, cut, used * sizeof *cut);
    return used;
}

/* Blends `colour` in along the segment from a to b (pixels). Where strokes overlap the darker wins,
 * for which the coverage is kept. */
static void cover_segment(float *coverage, size_t width, size_t height, struct point a,
                          struct point b, double radius)
{
    double low_x = floor(fmin(a.x, b.x) - radius - 1), high_x = ceil(fmax(a.x, b.x) + radius + 1);
    double low_y = floor(fmin(a.y, b.y) - radius - 1), high_y = ceil(fmax(a.y, b.y) + radius + 1);
    size_t x0 = low_x > 0 ? (size_t)low_x : 0, y0 = low_y > 0 ? (size_t)low_y : 0;
    size_t x1 = high_x > 0 ? (size_t)high_x : 0, y1 = high_y > 0 ? (size_t)high_y : 0;
    double dx = b.x - a.x, dy = b.y - a.y, length = dx * dx + dy * dy;
    for (size_t y = y0; y < y1 && y < height; y++) {
        for (size_t x = x0; x < x1 && x < width; x++) {
            double px = (double)x + 0.5 - a.x, py = (double)y + 0.5 - a.y;
            double t = length > 0 ? (px * dx + py * dy) / length : 0;
            t = t < 0 ? 0 : t > 1 ? 1 : t;
            double ex = px - t * dx, ey = py - t * dy;
            double covered = radius + 0.5 - sqrt(ex * ex + ey * ey);
            covered = covered < 0 ? 0 : covered > 1 ? 1 : covered;
            float *at = &coverage[y * width + x];
            *at = (float)covered > *at ? (float)covered : *at;
        }
    }
}

/* `left`, `top`: of the box that coverage stands for; scale: pixels a glyph unit. */
static void cover_glyph(float *coverage, size_t width, size_t height, char letter, double x,
                        double y, double scale)
{
    const char *glyph = glyph_of(letter);
    struct point points[POINTS_MAX];
    char kind;
    size_t count;
    while ((count = read_stroke(&glyph, &kind, points)) > 0) {
        bool closed = kind == 'o';
        for (int i = 0; i < CHAIKIN_ROUNDS && (closed || kind == '~') && count > 2; i++)
            count = cut_corners(points, count, closed);
        for (size_t i = 0; i < count; i++)
            points[i] = (struct point){x + (points[i].x + pen_radius) * scale,
                                       y - (points[i].y - baseline) * scale};
        size_t segments = closed ? count : count - 1;
        double radius = pen_radius * scale * (kind == '.' ? 1.35 : 1);
        if (segments == 0)
            cover_segment(coverage, width, height, points[0], points[0], radius);
        for (size_t i = 0; i < segments; i++)
            cover_segment(coverage, width, height, points[i], points[(i + 1) % count], radius);
    }
}

void text_draw(struct picture *picture, const char *text, double x, double y, double size,
               uint32_t colour)
{
    /* One glyph at a time, in a box that is large enough for it. */
    float coverage[PICTURE_GLYPH_SIZE * PICTURE_GLYPH_SIZE];
    double scale = size / capital;
    if (!(size > 0) || 13 * scale + 2 > PICTURE_GLYPH_SIZE)
        return;
    size_t side = (size_t)(13 * scale) + 2;
    for (const char *at = text; *at; at++) {
        double left = floor(x), top = floor(y - 9 * scale);
        memset(coverage, 0, side * side * sizeof *coverage);
        cover_glyph(coverage, side, side, *at, x - left, y - top, scale);
        for (size_t row = 0; row < side; row++)
            for (size_t column = 0; column < side; column++)
                if (coverage[row * side + column] > 0)
                    picture_blend(picture, (int64_t)left + (int64_t)column,
                                  (int64_t)top + (int64_t)row, colour,
                                  (double)coverage[row * side + column]);
        x += (glyph_width(*at) + gap) * scale;
    }
}
