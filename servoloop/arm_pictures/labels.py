"""Draw lines and text on an image.

All lines and text are drawn at three times their size and scaled down, so that they are smooth.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from hal.types import FloatArray
from sim_backend.scene.picture import Picture

Rgb = tuple[int, int, int]
INK: Final[Rgb] = (28, 32, 38)
PAPER: Final = (255, 255, 255, 215)
COLORS: Final[tuple[Rgb, ...]] = (
    (200, 30, 90), (20, 105, 190), (20, 130, 70), (150, 60, 170), (205, 85, 10), (0, 120, 130), (110, 80, 30),
)  # fmt: skip
"""Colors of the joints, in order. They repeat if there are more joints than colors."""
LARGER: Final = 3
TEXT_PX: Final = 19
SMALL_PX: Final = 15
LINE_SHARE: Final = 1.35
CHARACTERS: Final = 30
"""Maximum number of characters in a line of small text."""
LINE_PX: Final = 4.0
HEAD_PX: Final = 14.0
PAD_PX: Final = 6
GAP_PX: Final = 8


@dataclass(frozen=True, slots=True)
class Label:
    """Text at the side of the image, with a line to the labeled point (2,), in pixels."""

    title: str
    text: str
    place: FloatArray
    color: Rgb


class Drawing:
    """Image with lines and text drawn on it."""

    def __init__(self, picture: Picture) -> None:
        self._image = Image.fromarray(picture)
        self._width, self._height = self._image.size
        self._layer = Image.new("RGBA", (LARGER * self._width, LARGER * self._height))
        self._pen = ImageDraw.Draw(self._layer)

    def arrow(self, points: FloatArray, color: Rgb) -> None:
        """Draw an arrow along points (k, 2)."""
        along = points[-1] - points[-2]
        along /= max(float(np.linalg.norm(along)), 1e-9)
        across = np.array([-along[1], along[0]])
        tip = points[-1] + 0.5 * HEAD_PX * along
        back = tip - HEAD_PX * along
        self.line(points, color)
        self._pen.polygon(_flat([tip, back + 0.5 * HEAD_PX * across, back - 0.5 * HEAD_PX * across]), fill=color)

    def line(self, points: FloatArray, color: Rgb, width_px: float = LINE_PX) -> None:
        """Draw a line along points (k, 2)."""
        self._pen.line(_flat(points), fill=color, width=round(LARGER * width_px), joint="curve")

    def dot(self, place: FloatArray, color: Rgb, radius_px: float = 5.0) -> None:
        """Draw a dot at a point (2,)."""
        x, y = LARGER * place
        self._pen.circle((x, y), LARGER * radius_px, fill=color, outline=(255, 255, 255), width=LARGER)

    def labels(self, labels: Sequence[Label]) -> None:
        """Write labels on both sides, each as close as possible to the height of its point."""
        middle = float(np.median([label.place[0] for label in labels]))
        for left in (True, False):
            column = sorted((one for one in labels if (one.place[0] <= middle) == left), key=lambda one: one.place[1])
            sizes = [self._size(label) for label in column]
            tops = _spread([one.place[1] for one in column], [height for _, height in sizes], self._height)
            for label, (width, height), top in zip(column, sizes, tops, strict=True):
                edge = 2.0 * PAD_PX if left else self._width - 2.0 * PAD_PX - width
                inner = np.array([edge + width if left else edge, top + 0.5 * height])
                self.line(np.array([inner, label.place]), label.color, 1.5)
                self.dot(label.place, label.color)
                self._write(label, edge, top, (width, height))

    def caption(self, text: str) -> None:
        """Write a line of text at the bottom edge."""
        label = Label(text, "", np.zeros(2), INK)
        width, height = self._size(label)
        self._write(label, 0.5 * (self._width - width), self._height - height - 2.0 * PAD_PX, (width, height))

    def image(self) -> Image.Image:
        """Return the image with all drawings."""
        small = self._layer.resize(self._image.size, Image.Resampling.LANCZOS)
        return Image.alpha_composite(self._image.convert("RGBA"), small).convert("RGB")

    def _size(self, label: Label) -> tuple[float, float]:
        lines = _lines(label)
        widths = [_font(TEXT_PX).getlength(label.title), *map(_font(SMALL_PX).getlength, lines)]
        height = LINE_SHARE * (TEXT_PX + SMALL_PX * len(lines)) + PAD_PX
        return max(widths) / LARGER + 2.0 * PAD_PX, height

    def _write(self, label: Label, x: float, y: float, size: tuple[float, float]) -> None:
        box = [LARGER * x, LARGER * y, LARGER * (x + size[0]), LARGER * (y + size[1])]
        self._pen.rounded_rectangle(box, LARGER * PAD_PX, fill=PAPER, outline=label.color, width=LARGER)
        x, y = x + PAD_PX, y + 0.5 * PAD_PX
        self._pen.text((LARGER * x, LARGER * y), label.title, label.color, _font(TEXT_PX))
        y += LINE_SHARE * TEXT_PX
        for line in _lines(label):
            self._pen.text((LARGER * x, LARGER * y), line, INK, _font(SMALL_PX))
            y += LINE_SHARE * SMALL_PX


def _spread(places: Sequence[float], heights: Sequence[float], room: float) -> list[float]:
    """Return the top edge of each label, from top to bottom, so that each label is near its place and none overlap."""
    tops: list[float] = []
    for place, height in zip(places, heights, strict=True):
        tops.append(max(place - 0.5 * height, tops[-1] + heights[len(tops) - 1] + GAP_PX if tops else GAP_PX))
    below = room - 2.0 * PAD_PX
    for at in reversed(range(len(tops))):
        tops[at] = min(tops[at], below - heights[at])
        below = tops[at] - GAP_PX
    return tops


def _lines(label: Label) -> list[str]:
    return wrap(label.text, CHARACTERS)


def _font(size_px: int) -> Any:
    return ImageFont.load_default(LARGER * size_px)


def _flat(points: Any) -> list[tuple[float, float]]:
    return [(float(LARGER * x), float(LARGER * y)) for x, y in points]
