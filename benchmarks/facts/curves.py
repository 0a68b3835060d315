"""Draw time curves in one image, stacked vertically, each with its own scale."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from PIL import Image, ImageDraw

WIDTH, HEIGHT, MARGIN = 800, 260, 24


def draw(path: Path, curves: Mapping[str, Sequence[float]]) -> None:
    """Draw each curve (one value per millisecond) with its name and its extreme values."""
    image = Image.new("RGB", (WIDTH, HEIGHT * len(curves)), "white")
    pen = ImageDraw.Draw(image)
    for row, (name, values) in enumerate(curves.items()):
        lowest, highest = min(values), max(values)
        bottom, tall = HEIGHT * (row + 1) - MARGIN, HEIGHT - 2 * MARGIN
        scale = tall / ((highest - lowest) or 1.0)
        wide = (WIDTH - 2 * MARGIN) / max(1, len(values) - 1)
        pen.line([(MARGIN, bottom), (WIDTH - MARGIN, bottom)], "lightgray")
        points = [(MARGIN + ms * wide, bottom - (value - lowest) * scale) for ms, value in enumerate(values)]
        pen.line(points, "navy", 2)
        text = f"{name}: {lowest:g} to {highest:g} within {len(values)} ms"
        pen.text((MARGIN, HEIGHT * row + 6), text, "black")
    image.save(path)
