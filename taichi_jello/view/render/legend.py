"""What is written over a picture: the colour scale, the time, and in a window the state and the help.

A `Sheet` holds one geometry in pixels, y down: `stamp` draws it into a finished image, a window draws its
`quads` and `segments`.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.springs import Key
from taichi_jello.view.render.strokefont import strokes, text_width

ROWS = 720  # sizes below are pixels of a picture this high
MARGIN = 28.0
TEXT = 12.5  # the height of a capital
LEAST = 7.0  # that of one in a small picture, if it is at least WIDE: smaller ones cannot be read
WIDE = 300  # pixels
PEN = 0.13  # the pen's width, of the height of a capital
BAR = (230.0, 12.0)
LEADING = 1.75  # from baseline to baseline, of the height of a capital


@dataclass(frozen=True)
class Text:
    words: str
    x: float
    y: float
    height: float
    rgb: tuple[float, float, float]
    pen: float = PEN

    @property
    def width(self) -> float:
        """Of its strokes [pixels]."""
        return max(self.pen * self.height, 1.3)

    def segments(self) -> np.ndarray:
        """(n, 2, 2) [pixels]."""
        return strokes(self.words, self.x, self.y, self.height)


@dataclass(frozen=True)
class Line:
    """A polyline through points (n, 2), `width` wide."""

    points: np.ndarray
    width: float
    rgb: tuple[float, float, float]

    def segments(self) -> np.ndarray:
        """(n - 1, 2, 2) [pixels]."""
        return np.stack([self.points[:-1], self.points[1:]], 1)


@dataclass(frozen=True)
class Quad:
    """A filled upright rectangle that blends from its left colour to its right one."""

    x: float
    y: float
    width: float
    height: float
    left: np.ndarray
    right: np.ndarray


@dataclass
class Sheet:
    """Rectangles, under lines and text, for a picture of `size` (width, height) [pixels].

    What is drawn with a wide pen lies under what is drawn with a narrow one."""

    size: tuple[int, int]
    texts: list[Text] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    quads: list[Quad] = field(default_factory=list)

    @property
    def scale(self) -> float:
        return max(self.size[1] / ROWS, LEAST / TEXT * min(1.0, self.size[0] / WIDE))

    def text(
        self, words: str, x: float, y: float, height: float, rgb=palette.INK, align: float = 0.0, pen: float = PEN
    ) -> None:
        """Write on the baseline y; align 0 starts at x, 1 ends there, 0.5 is centred. pen: width, of the height."""
        left = x - align * text_width(words, height)
        self.texts.append(Text(words, left, y, height, _color(rgb), pen))

    def line(self, points: np.ndarray, width: float, rgb=palette.INK) -> None:
        """Draw through points (n, 2)."""
        self.lines.append(Line(np.asarray(points, float), width, _color(rgb)))

    def quad(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        left: np.ndarray,
        right: np.ndarray | None = None,
    ):
        self.quads.append(Quad(x, y, width, height, left, left if right is None else right))

    def stamp(self, image: np.ndarray) -> None:
        """Draw into image (height, width, 3) uint8 in place."""
        for quad in self.quads:
            _fill(image, quad)
        for line in sorted(self.lines, key=lambda line: -line.width):
            _draw(image, line)
        for text in self.texts:
            _write(image, text)


def _color(rgb: Any) -> tuple[float, float, float]:
    red, green, blue = (float(c) for c in rgb)
    return red, green, blue


def _fill(image: np.ndarray, quad: Quad) -> None:
    x0, x1 = (int(np.clip(round(v), 0, image.shape[1])) for v in (quad.x, quad.x + quad.width))
    y0, y1 = (int(np.clip(round(v), 0, image.shape[0])) for v in (quad.y, quad.y + quad.height))
    if x1 > x0 and y1 > y0:
        t = ((np.arange(x0, x1) + 0.5 - quad.x) / quad.width).clip(0.0, 1.0)[:, None]
        image[y0:y1, x0:x1] = (255.0 * (quad.left + (quad.right - quad.left) * t) + 0.5).astype(np.uint8)


def _draw(image: np.ndarray, line: Line) -> None:
    ink, left, top = _ink(line.segments(), 0.5 * line.width)
    _blend(image, ink, left, top, line.rgb)


@lru_cache(maxsize=512)
def _mask(words: str, height: float, shift: tuple[float, float], pen: float) -> tuple[np.ndarray, int, int]:
    """What `_ink` says of one piece of text."""
    return _ink(strokes(words, shift[0], shift[1], height), max(0.5 * pen * height, 0.55))


def _ink(segments: np.ndarray, half: float) -> tuple[np.ndarray, int, int]:
    """How much ink covers each pixel, 0 to 1, for strokes 2 · half wide; the column and row where it begins."""
    if not len(segments):
        return np.zeros((0, 0)), 0, 0
    low = np.floor(segments.min((0, 1)) - half - 1.0).astype(int)
    high = np.ceil(segments.max((0, 1)) + half + 1.0).astype(int)
    ink = np.zeros((high[1] - low[1], high[0] - low[0]))
    for a, b in segments - low:
        left, top = np.maximum(np.minimum(a, b) - half - 1.0, 0.0).astype(int)
        right, bottom = (np.maximum(a, b) + half + 2.0).astype(int)
        y, x = np.mgrid[top : min(bottom, len(ink)), left : min(right, ink.shape[1])] + 0.5
        d = b - a
        along = ((x - a[0]) * d[0] + (y - a[1]) * d[1]) / max(float(d @ d), 1e-9)
        along = along.clip(0.0, 1.0)
        away = np.hypot(x - a[0] - along * d[0], y - a[1] - along * d[1])
        part = ink[top:bottom, left:right]
        np.maximum(part, (half + 0.5 - away).clip(0.0, 1.0), out=part)
    return ink, int(low[0]), int(low[1])


def _write(image: np.ndarray, text: Text) -> None:
    # Single characters repeat from frame to frame while whole lines, such as the time, do not.
    pen = text.x
    for character in text.words:
        column, row = int(np.floor(pen)), int(np.floor(text.y))
        ink, left, top = _mask(character, text.height, (round(pen - column, 2), round(text.y - row, 2)), text.pen)
        _blend(image, ink, column + left, row + top, text.rgb)
        pen += text_width(character + " ", text.height) - text_width(" ", text.height)


def _blend(image: np.ndarray, ink: np.ndarray, x: int, y: int, rgb: tuple[float, float, float]) -> None:
    y0, x0 = max(-y, 0), max(-x, 0)
    y1, x1 = min(len(ink), image.shape[0] - y), min(ink.shape[1] if ink.size else 0, image.shape[1] - x)
    if y1 > y0 and x1 > x0:
        part = image[y + y0 : y + y1, x + x0 : x + x1]
        cover = ink[y0:y1, x0:x1, None]
        part[:] = (part + (255.0 * np.array(rgb) - part) * cover + 0.5).astype(np.uint8)


def number(value: float) -> str:
    """A scale's end in a few characters: 0.02, 5, 2000, 2e6."""
    return f"{value:g}"


def legend(key: Key, time: float, size: tuple[int, int]) -> Sheet:
    """The colour scale in the lower left corner and the time [s] in the lower right one."""
    sheet = Sheet(size)
    s = sheet.scale
    height, margin, bottom = TEXT * s, MARGIN * s, size[1] - MARGIN * s
    sheet.text(f"t = {time:.2f} s", size[0] - margin, bottom, height, align=1.0)
    if key.ramp is not None:
        width, thick = BAR[0] * s, BAR[1] * s
        top = bottom - height - thick - 8.0 * s
        sheet.text(key.title, margin, top - 9.0 * s, height)
        knots = key.ramp[np.linspace(0, len(key.ramp) - 1, 17).astype(int)]
        for k in range(16):
            left, right = (margin + width * n / 16 for n in (k, k + 1))
            sheet.quad(left, top, right - left, thick, knots[k], knots[k + 1])
        sheet.text("0", margin, bottom, height)
        sheet.text(f"{number(key.most)} {key.unit}", margin + width, bottom, height, align=1.0)
    for k, (name, rgb) in enumerate(reversed(key.names)):
        y = bottom - k * LEADING * height
        sheet.quad(margin, y - 0.62 * height, 26.0 * s, 0.34 * height, np.asarray(rgb))
        sheet.text(name, margin + 36.0 * s, y, height)
    if key.names:
        sheet.text(key.title, margin, bottom - len(key.names) * LEADING * height - 2.0 * s, height)
    return sheet
