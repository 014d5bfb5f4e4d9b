# SPDX-License-Identifier: Apache-2.0
"""Parts of SVG pictures as text, for the scripts of this folder that draw. Points are (x, y) in pixels."""
from dataclasses import dataclass
from xml.sax.saxutils import escape

COLOURS = ("#1f6feb", "#d1242f", "#1a7f37", "#8250df", "#bf8700")
GRID = "#ddd"


def colour(i):
    """The colour of the i-th curve; they repeat."""
    return COLOURS[i % len(COLOURS)]


@dataclass(frozen=True)
class Panel:
    """A rectangle of the picture that shows values of x from 0 to x_end, and of y from 0 at its foot to y_end."""

    left: float
    top: float
    width: float
    height: float
    x_end: float
    y_end: float

    def at(self, x, y):
        return (self.left + x / self.x_end * self.width, self.top + self.height - y / self.y_end * self.height)

    def across(self, y, **looks):
        """A line through the whole panel at the height of y."""
        return line(self.at(0, y), self.at(self.x_end, y), **looks)


def line(start, end, stroke=GRID, dashed=False):
    dashes = ' stroke-dasharray="6 4"' if dashed else ""
    return (f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}" '
            f'stroke="{stroke}"{dashes}/>')


def polyline(points, stroke):
    line_points = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{line_points}" fill="none" stroke="{stroke}" stroke-width="2"/>'


def circle(centre, radius, fill):
    return f'<circle cx="{centre[0]:.1f}" cy="{centre[1]:.1f}" r="{radius}" fill="{fill}"/>'


def bar(upper_left, lower_right, fill):
    (left, top), (right, bottom) = upper_left, lower_right
    return (f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}" '
            f'fill="{fill}"/>')


def text(at, content, anchor="start", fill="black"):
    """The point is at the text's start, middle or end (anchor). Characters that XML cannot hold are left out."""
    shown = escape("".join(c for c in content if c.isprintable()))
    return f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" text-anchor="{anchor}" fill="{fill}">{shown}</text>'


def document(width, height, parts):
    body = "\n".join(parts)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" '
            f'font-size="12">\n<rect width="100%" height="100%" fill="white"/>\n{body}\n</svg>\n')
