"""Patches: private or replaced parts of rclpy, with the versions that each patch supports."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

RCLPY_7_1_5: Final = frozenset({"7.1.5"})
"""Version reported by rclpy itself. The wheel of this version is published as ros-rclpy 7.1.6. Version 7.1.9 resumes
callbacks differently."""


@dataclass(frozen=True, slots=True)
class Patch:
    """A patch of rclpy. The patch is used only with one of the ``versions``, and only if ``differences`` finds no
    difference."""

    name: str
    versions: frozenset[str]
    loss: str
    """Effect of the missing patch on the stack, phrased as a clause for the warning."""
    differences: Callable[[], Iterable[str]]
    """Function that lists differences between the installed and the supported rclpy. The function may raise any
    exception."""


def missing(owner: Any, names: Iterable[str]) -> list[str]:
    """Return a sentence for each name that is missing from a class or module."""
    return [f"{owner.__name__} has no {name}" for name in names if not hasattr(owner, name)]
