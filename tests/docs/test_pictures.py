"""Tests that every image of the documentation is used, and that its page names the script that generates it."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageSequence

from tests.pages import DOCS, ROOT, commands, pages
from tests.view.chromium import find_chromium

PICTURES = sorted(path for path in DOCS.rglob("*") if path.suffix in (".png", ".gif", ".svg", ".jpg"))
SHOWN = re.compile(r"!\[[^\]]*\]\(([^)\s]+)\)")
SCRIPTS = {
    command
    for page in pages()
    for command in commands(page)
    if re.match(r"python tools/.*\.(png|gif|svg|jpg)$", command)
}
VIEW = "python tools/view_picture.py docs/view.png"
SIMULATED = sorted(SCRIPTS - {VIEW})
"""Scripts that compute their images only from numbers, so that the images are equal on every machine."""
OTHER = 0.01
"""Share of pixels that may differ clearly, because the physics of another machine may be rounded differently."""


def shown_by(page: str) -> set[Path]:
    path = pages()[page]
    return {(path.parent / name).resolve() for name in SHOWN.findall(path.read_text())}


def test_every_picture_is_shown() -> None:
    assert set().union(*map(shown_by, pages())) == set(PICTURES)


@pytest.mark.parametrize("page", [page for page in pages() if shown_by(page)])
def test_a_page_names_the_script_of_its_pictures(page: str) -> None:
    for picture in shown_by(page):
        name = re.escape(str(picture.relative_to(ROOT)))
        named = re.search(rf"python (tools/\w+\.py) [^`\n]*{name}$", pages()[page].read_text(), re.MULTILINE)
        in_one_line = re.sub(r"\s+", " ", pages()[page].read_text())
        named = named or re.search(rf"`python (tools/\w+\.py) [^`]*{name}`", in_one_line)
        assert named and (ROOT / named[1]).is_file(), picture


def run(command: str, folder: Path) -> tuple[Path, Path]:
    """Return the image that a command of the page draws on this machine, and the image in docs/."""
    *words, picture = shlex.split(command)
    drawn = folder / Path(picture).name
    subprocess.run([sys.executable, *words[1:], str(drawn)], cwd=ROOT, check=True, timeout=110.0)
    return drawn, ROOT / picture


def pixels(path: Path) -> list[NDArray[np.uint8]]:
    """All frames."""
    with Image.open(path) as image:
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]


def when(command: str) -> pytest.MarkDecorator:
    """Mark all images of the scripts for arms and guide as slow, except for one."""
    seldom = "docs/arms/" in command or ("docs/so101/" in command and not command.endswith("joints.png"))
    return pytest.mark.soak if seldom else pytest.mark.slow


@pytest.mark.runs(*SIMULATED)
@pytest.mark.parametrize("command", [pytest.param(command, marks=when(command)) for command in SIMULATED])
def test_the_script_draws_the_picture_in_the_repository(command: str, tmp_path: Path) -> None:
    drawn, kept = run(command, tmp_path)
    if kept.suffix == ".svg":
        assert drawn.read_text().count("<") == kept.read_text().count("<")
        return
    for one, other in zip(pixels(drawn), pixels(kept), strict=True):
        assert one.shape == other.shape
        assert (np.abs(one.astype(int) - other).max(axis=2) > 40).mean() < OTHER


@pytest.mark.slow
@pytest.mark.runs(VIEW)
def test_the_picture_of_the_view_is_drawn(tmp_path: Path) -> None:
    find_chromium()
    (drawn,), (kept,) = map(pixels, run(VIEW, tmp_path))
    assert drawn.shape == kept.shape and len(np.unique(drawn.reshape(-1, 3), axis=0)) > 100
