"""A patch: one private or replaced part of rclpy, with the versions that it is known for."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

RCLPY_7_1_5: Final = frozenset({"7.1.5"})
"""rclpy's own number; its wheel is called ros-rclpy 7.1.6. 7.1.9 resumes callbacks that wait in another way."""


@dataclass(frozen=True, slots=True)
class Patch:
    """Used only on one of ``versions``, and where ``differences`` finds none."""

    name: str
    versions: frozenset[str]
    loss: str
    """The stack's loss on plain rclpy, in words."""
    differences: Callable[[], Iterable[str]]
    """Lists how this rclpy differs from the one that the patch was written for; may raise anything."""


def missing(owner: Any, names: Iterable[str]) -> list[str]:
    """The names that a class or module lacks, in words."""
    return [f"{owner.__name__} has no {name}" for name in names if not hasattr(owner, name)]
