"""Arms of a scene. In a scene with several arms, the element names of each arm begin with the arm's prefix."""

from collections.abc import Sequence
from typing import Any, Final

import mujoco

ARMS: Final = "arms"
"""Name of the custom text that lists the prefixes of a scene with several arms, separated by spaces."""
ONE_ARM: Final = ("",)
"""Prefixes for a scene with one arm, whose element names have no prefix."""


def arm_prefixes(model: Any) -> tuple[str, ...]:
    """Return the prefix of each arm in a compiled scene, such as ``left_`` and ``right_``."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, ARMS)
    if number < 0:
        return ONE_ARM
    begin = int(model.text_adr[number])
    text = model.text_data[begin : begin + int(model.text_size[number])].decode().rstrip("\0")
    return tuple(text.split()) or ONE_ARM


def part_name(model: Any, geom: int) -> str:
    """Return the name of the body that a geom belongs to, or the geom's own name if the geom is fixed to the world."""
    body = int(model.geom_bodyid[geom])
    return str(model.body(body).name if body else model.geom(geom).name)


def prefix_of(name: str, prefixes: Sequence[str]) -> str | None:
    """Return the prefix of the arm to which a name belongs, or None. If several prefixes match, return the longest
    prefix."""
    return max((prefix for prefix in prefixes if name.startswith(prefix)), key=len, default=None)
