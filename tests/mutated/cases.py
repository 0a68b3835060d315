"""Mutated files, each determined by its kind, a seed and a number."""

import logging
import re
import shutil
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Final

from servoloop.cli import ERRORS
from tests.mutated import elements, raw, trees
from tests.mutated.readers import KINDS

LONGEST_S: Final = 5.0
"""Maximum processor time for one file, in seconds."""
MOST_LINES: Final = 60
OF_THE_WHOLE: Final = (
    *("larger than", r"more than \d+ values", "cut off", "says nothing"),
    *("has no section for", "has no <ros2_control> block"),
)
"""Patterns of mistakes that concern a whole file and therefore have no line, such as its size or missing content."""
PLACE: Final = re.compile("|".join((r":\d+", r"[Ll]ine \d+", *OF_THE_WHOLE)))
"""Pattern of a line number, or of a mistake that concerns the whole file."""
FILE: Final = re.compile(r"[\w.-]+\.(yaml|urdf|srdf|xml|json|mcap)\b|LeRobot's file")
LINED: Final = (".yaml", ".urdf")
"""Suffixes of files whose readers report lines."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of reading a mutated file. ``wrong`` is empty if the file was read, or if it was refused with a good
    message."""

    refused: str
    wrong: str
    cpu_s: float


@cache
def good(kind: str) -> list[bytes]:
    return KINDS[kind].good()


def mutated(kind: str, seed: int, number: int) -> bytes:
    """Return the bytes of one mutated file, which depend only on the arguments."""
    chance = Random(f"{kind}/{seed}/{number}")
    data, suffix = chance.choice(good(kind)), KINDS[kind].name.rpartition(".")[2]
    if suffix == "mcap" or chance.random() < 0.2:
        return raw.changed(data, chance)
    text = data.decode()
    if chance.random() < 0.1:
        return raw.encoded(text, chance)
    if suffix in ("urdf", "xml", "srdf"):
        return elements.changed(text, chance).encode(errors="surrogatepass")
    return trees.changed(text, chance, as_json=suffix == "json").encode(errors="surrogatepass")


def tried(kind: str, data: bytes, folder: Path) -> Outcome:
    """Write the file into ``folder`` and read it as the commands do."""
    shutil.rmtree(folder, ignore_errors=True)
    path = folder / KINDS[kind].name
    path.parent.mkdir(parents=True)
    KINDS[kind].beside(folder)
    path.write_bytes(data)
    begun_s = time.process_time()
    refused = wrong = ""
    try:
        KINDS[kind].read(path)
    except ERRORS as error:
        refused = str(error)
        wrong = complaint(refused, path)
    except Exception as error:
        wrong = f"{type(error).__name__}: {error}"[:500] + _where(error)
    cpu_s = time.process_time() - begun_s
    return Outcome(refused, wrong or (f"took {cpu_s:.1f} s" if cpu_s > LONGEST_S else ""), cpu_s)


def _where(error: Exception) -> str:
    """Return the last place within this project in a traceback."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "site-packages" not in f.filename]
    return f" at {Path(frames[-1].filename).name}:{frames[-1].lineno}"


def complaint(text: str, path: Path) -> str:
    """Return the reason why an error message is not helpful, or an empty string if it is helpful."""
    lines = text.splitlines()
    if not FILE.search(text):
        return f"does not name a file: {text[:300]}"
    if path.name in text and path.suffix in LINED and not PLACE.search(text):
        return f"does not name the line: {text[:300]}"
    return f"has {len(lines)} lines: {text[:300]}" if len(lines) > MOST_LINES else ""


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress warnings about files with unusual values."""
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)
