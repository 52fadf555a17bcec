"""Charts as SVG, for the records: points and lines on logarithmic axes, with labels. (The plotting
libraries would be a large installation for two charts.)"""
import math
from xml.sax.saxutils import escape

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 860, 560, 80, 24, 48, 60
COLOURS = ("#3b6fb6", "#c2452d", "#3f8f4f", "#8a5fa8", "#b07d2b", "#4a4a4a", "#2a9d9d", "#c05a8f")


def tidy(value):
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e") if value < 0.01 or value >= 1e5 \
        else f"{value:g}"


def ticks(low, high):
    """1, 2 and 5 times the powers of ten between low and high; the powers alone if these are many."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    factors = (1,) if last - first > 4 else (1, 2, 5)
    found = [factor * 10.0 ** power for power in range(first, last + 1) for factor in factors]
    return [value for value in found if low <= value <= high]


class Axis:
    def __init__(self, values, begin, end):
        spread = (max(values) / min(values)) ** 0.08
        self.low, self.high = min(values) / max(spread, 1.1), max(values) * max(spread, 1.1)
        self.begin, self.end = begin, end

    def place(self, value):
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return self.begin + share * (self.end - self.begin)


def apart(labels, gap=14):
    """Moves labels (x, y, text, colour) that would lie on each other down, from the top on."""
    placed = []
    for x, y, text, colour in sorted(labels, key=lambda label: label[1]):
        width = 6.9 * len(text)
        for other_x, other_y, other_text, _ in placed:
            if (abs(y - other_y) < gap and x < other_x + 6.9 * len(other_text)
                    and other_x < x + width):
                y = other_y + gap
        placed.append((x, y, text, colour))
    return placed


def chart(path, title, x_title, y_title, series):
    """Writes an SVG. `series`: list of (name, points, joined); a point is (x, y, label)."""
    points = [point for _, found, _ in series for point in found]
    x_axis = Axis([point[0] for point in points], LEFT, WIDTH - RIGHT)
    y_axis = Axis([point[1] for point in points], HEIGHT - BOTTOM, TOP)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
             'font-family="sans-serif" font-size="12">',
             f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
             f'<text x="{LEFT}" y="26" font-size="16">{escape(title)}</text>']
    for value in ticks(x_axis.low, x_axis.high):
        x = x_axis.place(value)
        parts.append(f'<path d="M{x:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#ddd"/>'
                     f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">'
                     f'{tidy(value)}</text>')
    for value in ticks(y_axis.low, y_axis.high):
        y = y_axis.place(value)
        parts.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>'
                     f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tidy(value)}</text>')
    parts.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 16}" text-anchor="middle">'
                 f'{escape(x_title)}</text><text transform="translate(20 {HEIGHT / 2}) rotate(-90)" '
                 f'text-anchor="middle">{escape(y_title)}</text>')
    labels = []
    for number, (name, found, joined) in enumerate(series):
        colour = COLOURS[number % len(COLOURS)]
        placed = [(x_axis.place(x), y_axis.place(y), label) for x, y, label in found]
        if joined and len(placed) > 1:
            line = "L".join(f"{x:.1f} {y:.1f}" for x, y, _ in placed)
            parts.append(f'<path d="M{line}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        for x, y, label in placed:
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{colour}"/>')
            text = label if label is not None else name
            if text:
                right = x + 8 + 6.9 * len(text) < WIDTH - RIGHT
                labels.append((x + 8, y + 4, text, colour) if right
                              else (x - 8 - 6.9 * len(text), y + 20, text, colour))
    for x, y, text, colour in apart(labels):
        parts.append(f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}">{escape(text)}</text>')
    parts.append("</svg>\n")
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join(parts))
