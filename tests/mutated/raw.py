"""Changes of bytes regardless of their meaning: flipped bits, cuts, lost or repeated parts, and other encodings."""

from random import Random
from typing import Final

from tests.mutated.nonsense import IN_TEXT

ENCODINGS: Final = ("latin-1", "gbk", "utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp1252", "utf-7")
FOREIGN: Final = "# Länge, 机械臂\n"


def changed(data: bytes, chance: Random) -> bytes:
    """Return the data with one to four changes."""
    found = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        _change(found, chance)
    return bytes(found)


def _change(data: bytearray, chance: Random) -> None:
    at, size = chance.randint(0, len(data)), chance.choice((1, 2, 8, 100, 1000))
    kind = chance.randrange(7)
    if kind == 0 and at < len(data):
        data[at] ^= 1 << chance.randrange(8)
    elif kind == 1 and at < len(data):
        data[at] = chance.randrange(256)
    elif kind == 2:
        del data[at : at + size]
    elif kind == 3:
        data[at:at] = data[at : at + size]
    elif kind == 4:
        data[at:at] = chance.choice(IN_TEXT)
    elif kind == 5:
        data[at:at] = chance.randbytes(min(size, 100))
    else:
        del data[at:]


def encoded(text: str, chance: Random) -> bytes:
    """Return the text in a random encoding, which may differ from the declared one."""
    return (text + FOREIGN * chance.randrange(2)).encode(chance.choice(ENCODINGS), errors="replace")
