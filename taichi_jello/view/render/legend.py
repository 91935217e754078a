"""Rectangles, lines and text over a picture, and the legend. A window draws the same geometry itself."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.primitives import ROWS
from taichi_jello.view.drawing.springs import Key
from taichi_jello.view.render.strokefont import strokes, text_width

# Sizes in pixels of a picture of ROWS.
MARGIN = 28.0
TEXT = 12.5  # the height of a capital
BAR = (230.0, 12.0)  # width and height of the colour ramp
STEPS = 16  # of the ramp, each blended from one colour to the next
MIN_TEXT = 7.0  # height [pixels] of a capital that can be read, in a picture at least
MIN_COLUMNS = 300  # wide
PEN = 0.13  # the pen's width over the height of a capital
LEADING = 1.75  # from baseline to baseline over the height of a capital

Color = np.ndarray  # (3,)


@dataclass(frozen=True)
class Text:
    """Words whose baseline begins at (x, y); height of a capital [pixels]; pen: width of the strokes over it."""

    words: str
    x: float
    y: float
    height: float
    rgb: Color
    pen: float = PEN

    @property
    def width(self) -> float:
        """Of the strokes [pixels]."""
        return max(self.pen * self.height, 1.3)

    def segments(self) -> np.ndarray:
        """(n, 2, 2) [pixels]."""
        return strokes(self.words, self.x, self.y, self.height)


@dataclass(frozen=True)
class Line:
    """A polyline through points (n, 2), `width` wide [pixels]."""

    points: np.ndarray
    width: float
    rgb: Color

    def segments(self) -> np.ndarray:
        """(n - 1, 2, 2) [pixels]."""
        return np.stack([self.points[:-1], self.points[1:]], 1)


@dataclass(frozen=True)
class Quad:
    """A filled upright rectangle [pixels], blended from its left colour to its right one."""

    x: float
    y: float
    width: float
    height: float
    left: np.ndarray
    right: np.ndarray


@dataclass
class Sheet:
    """Rectangles below lines and text, for a picture of `size` (width, height) [pixels], y down. Thick strokes lie
    below thin ones."""

    size: tuple[int, int]
    texts: list[Text] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    quads: list[Quad] = field(default_factory=list)

    @property
    def scale(self) -> float:
        """From sizes at ROWS to pixels here."""
        return max(self.size[1] / ROWS, MIN_TEXT / TEXT * min(1.0, self.size[0] / MIN_COLUMNS))

    def text(
        self,
        words: str,
        x: float,
        y: float,
        height: float,
        rgb: Color = palette.INK,
        align: float = 0.0,
        pen: float = PEN,
    ) -> None:
        """Write on the baseline y, from x if `align` is 0, up to x if it is 1, centred if it is 0.5."""
        self.texts.append(Text(words, x - align * text_width(words, height), y, height, rgb, pen))

    def line(self, points: np.ndarray, width: float, rgb: Color = palette.INK) -> None:
        """Draw through points (n, 2)."""
        self.lines.append(Line(np.asarray(points, float), width, rgb))

    def quad(
        self, x: float, y: float, width: float, height: float, left: np.ndarray, right: np.ndarray | None = None
    ) -> None:
        """Fill a rectangle from its upper left corner (x, y)."""
        self.quads.append(Quad(x, y, width, height, left, left if right is None else right))

    def stamp(self, image: np.ndarray) -> None:
        """Draw into image (height, width, 3) uint8 in place."""
        for quad in self.quads:
            _fill(image, quad)
        for line in sorted(self.lines, key=lambda line: -line.width):
            _blend(image, *_coverage(line.segments(), 0.5 * line.width), line.rgb)
        for text in self.texts:
            _write(image, text)


def _fill(image: np.ndarray, quad: Quad) -> None:
    x0, x1 = (int(np.clip(round(v), 0, image.shape[1])) for v in (quad.x, quad.x + quad.width))
    y0, y1 = (int(np.clip(round(v), 0, image.shape[0])) for v in (quad.y, quad.y + quad.height))
    if x1 > x0 and y1 > y0:
        t = ((np.arange(x0, x1) + 0.5 - quad.x) / quad.width).clip(0.0, 1.0)[:, None]
        image[y0:y1, x0:x1] = (255.0 * (quad.left + (quad.right - quad.left) * t) + 0.5).astype(np.uint8)


def _coverage(segments: np.ndarray, half: float) -> tuple[np.ndarray, int, int]:
    """How much of each pixel, 0 to 1, strokes 2 · half wide cover; the column and row where this array begins."""
    if not len(segments):
        return np.zeros((0, 0)), 0, 0
    low = np.floor(segments.min((0, 1)) - half - 1.0).astype(int)
    high = np.ceil(segments.max((0, 1)) + half + 1.0).astype(int)
    cover = np.zeros((high[1] - low[1], high[0] - low[0]))
    for a, b in segments - low:
        left, top = np.maximum(np.minimum(a, b) - half - 1.0, 0.0).astype(int)
        right, bottom = (np.maximum(a, b) + half + 2.0).astype(int)
        y, x = np.mgrid[top : min(bottom, len(cover)), left : min(right, cover.shape[1])] + 0.5
        d = b - a
        along = ((x - a[0]) * d[0] + (y - a[1]) * d[1]) / max(float(d @ d), 1e-9)
        along = along.clip(0.0, 1.0)
        away = np.hypot(x - a[0] - along * d[0], y - a[1] - along * d[1])
        part = cover[top:bottom, left:right]
        np.maximum(part, (half + 0.5 - away).clip(0.0, 1.0), out=part)
    return cover, int(low[0]), int(low[1])


@lru_cache(maxsize=512)
def _glyph_coverage(character: str, height: float, x: float, y: float, pen: float) -> tuple[np.ndarray, int, int]:
    return _coverage(strokes(character, x, y, height), max(0.5 * pen * height, 0.55))


def _write(image: np.ndarray, text: Text) -> None:
    # By characters, for the cache: they repeat from frame to frame, whole lines, such as the time, do not.
    x, row = text.x, int(np.floor(text.y))
    for character in text.words:
        column = int(np.floor(x))
        shift = round(x - column, 2), round(text.y - row, 2)
        cover, left, top = _glyph_coverage(character, text.height, *shift, text.pen)
        _blend(image, cover, column + left, row + top, text.rgb)
        x += text_width(character + " ", text.height) - text_width(" ", text.height)


def _blend(image: np.ndarray, cover: np.ndarray, x: int, y: int, rgb: Color) -> None:
    y0, x0 = max(-y, 0), max(-x, 0)
    y1, x1 = min(cover.shape[0], image.shape[0] - y), min(cover.shape[1], image.shape[1] - x)
    if y1 > y0 and x1 > x0:
        part = image[y + y0 : y + y1, x + x0 : x + x1]
        part[:] = (part + (255.0 * np.array(rgb) - part) * cover[y0:y1, x0:x1, None] + 0.5).astype(np.uint8)


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
        knots = key.ramp[np.linspace(0, len(key.ramp) - 1, STEPS + 1).astype(int)]
        for k in range(STEPS):
            left, right = (margin + width * n / STEPS for n in (k, k + 1))
            sheet.quad(left, top, right - left, thick, knots[k], knots[k + 1])
        sheet.text("0", margin, bottom, height)
        sheet.text(f"{key.most:g} {key.unit}", margin + width, bottom, height, align=1.0)
    for k, (name, rgb) in enumerate(reversed(key.names)):
        y = bottom - k * LEADING * height
        sheet.quad(margin, y - 0.62 * height, 26.0 * s, 0.34 * height, np.asarray(rgb))
        sheet.text(name, margin + 36.0 * s, y, height)
    if key.names:
        sheet.text(key.title, margin, bottom - len(key.names) * LEADING * height - 2.0 * s, height)
    return sheet
