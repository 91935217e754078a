"""A stroke font: every glyph is a few polylines, sharp at any size."""

from functools import lru_cache

import numpy as np

UNIT = 6.0  # grid steps from the baseline to the top of a capital
BASE = 2  # grid row of the baseline
ADVANCE = 1.9  # grid steps between two glyphs

# A glyph: polylines separated by blanks, each a sequence of column-row pairs on a grid with the baseline at row 2, the
# top of small letters at row 6 and of capitals at row 8.
GLYPHS = {
    "0": "120307183847433212", "1": "062822", "2": "0718384746350242", "3": "0718384746354443321203 1535",
    "4": "380444 3832", "5": "480805354443321203", "6": "473818070312324344 443505", "7": "084812",
    "8": "15354647381807061504031232434435", "9": "0312324347381807061545", "A": "022842 1434",
    "B": "02083847463505 3544433202", "C": "4738180703123243", "D": "02083847433202", "E": "48080242 0535",
    "F": "480802 0535", "G": "47381807031232434525", "H": "0802 4842 0545", "I": "2822 1838 1232",
    "J": "48433212", "K": "0802 480542", "L": "080242", "M": "0208254842", "N": "02084248",
    "O": "120307183847433212", "P": "02083847463505", "Q": "120307183847433212 2442",
    "R": "02083847463505 2542", "S": "473818070615354443321203", "T": "0848 2822", "U": "080312324348",
    "V": "082248", "W": "0812253248", "X": "0842 4802", "Y": "082548 2522", "Z": "08480242",
    "a": "16364542 441403123243", "b": "0802 0516364543321203", "c": "4536160503123243",
    "d": "4842 4536160503123243", "e": "04444536160503123243", "f": "38281712 0636",
    "g": "4641301001 4536160503123243", "h": "0802 0516364542", "i": "1612 1718", "j": "26211001 2728",
    "k": "0802 460442", "l": "181322", "m": "0602 05162522 25364542", "n": "0602 0516364542",
    "o": "160503123243453616", "p": "0600 0516364543321203", "q": "4640 4536160503123243",
    "r": "0602 041636", "s": "4536160543321203", "t": "18132232 0636", "u": "0603123243 4642",
    "v": "062246", "w": "0612243246", "x": "0642 4602", "y": "0622 4610", "z": "06460242", ".": "2223",
    ",": "2311", ":": "2223 2526", "=": "0646 0444", "-": "0545", "+": "0545 2723", "/": "0248",
    "%": "0248 0818170708 3343423233", "(": "38272332", ")": "18272312", "'": "2826", "|": "2822",
    "²": "182827161626", ";": "2311 2526", "!": "2223 2528", "?": "07183847462423 2122", "_": "0141",
    "*": "2448 4408 0646", "[": "38181232", "]": "18383212", "<": "470543", ">": "074503",
    '"': "1816 3836", "~": "051636344445",
}  # fmt: skip
UNKNOWN = "0208484202"
WIDTH = 4  # grid steps, except of
WIDTHS = dict.fromkeys("1rIj.,:'|ft", 3) | {"i": 2, "l": 2, " ": 2.5}


@lru_cache(maxsize=256)
def glyph(character: str) -> tuple[np.ndarray, float]:
    """Segments (n, 2, 2) of one character, x to the right and y up from the baseline, and its width, both in units of
    a capital's height. An unknown character is a box."""
    runs = "" if character == " " else GLYPHS.get(character, UNKNOWN)
    segments = []
    for run in runs.split():
        points = np.array([[int(run[k]), int(run[k + 1]) - BASE] for k in range(0, len(run) - 1, 2)], float)
        segments += [points[k : k + 2] for k in range(len(points) - 1)]
    shape = np.array(segments).reshape(-1, 2, 2) / UNIT
    return shape, WIDTHS.get(character, WIDTH) / UNIT


def text_width(text: str, height: float) -> float:
    """The width of `text` with capitals `height` high, in the same unit."""
    return height * (sum(glyph(c)[1] + ADVANCE / UNIT for c in text) - ADVANCE / UNIT) if text else 0.0


@lru_cache(maxsize=256)
def strokes(text: str, x: float, y: float, height: float) -> np.ndarray:
    """(n, 2, 2) segments in pixels, y down: `text` with its baseline's left end at (x, y)."""
    parts, pen = [np.zeros((0, 2, 2))], x
    for character in text:
        shape, width = glyph(character)
        parts.append(shape * [height, -height] + [pen, y])
        pen += height * (width + ADVANCE / UNIT)
    return np.concatenate(parts)
