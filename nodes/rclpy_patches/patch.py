"""Define a patch: a private or replaced part of rclpy, with the versions it supports."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

RCLPY_7_1_5: Final = frozenset({"7.1.5"})
"""Version reported by rclpy itself; its wheel is named ros-rclpy 7.1.6. Version 7.1.9 resumes callbacks differently."""


@dataclass(frozen=True, slots=True)
class Patch:
    """A patch of rclpy. It is used only with one of ``versions``, and only if ``differences`` finds none."""

    name: str
    versions: frozenset[str]
    loss: str
    """Limitation of the stack without the patch, as a clause for the warning."""
    differences: Callable[[], Iterable[str]]
    """Function that lists differences of the installed rclpy from the supported one. It may raise any exception."""


def missing(owner: Any, names: Iterable[str]) -> list[str]:
    """Return a sentence for each name that a class or module lacks."""
    return [f"{owner.__name__} has no {name}" for name in names if not hasattr(owner, name)]
