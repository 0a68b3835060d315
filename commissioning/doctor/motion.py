"""The motion that some checks need: each joint moves a little, slowly, and the arm is limp before it and behind it."""

from collections.abc import Callable

from commissioning.doctor.finding import Finding
from commissioning.doctor.snapshot import JointMotion, Snapshot

Move = Callable[[Snapshot, tuple[Finding, ...]], tuple[tuple[JointMotion, ...], str]]
"""Is given what is known so far; returns the motions, or why there are none."""


def no_move(snapshot: Snapshot, findings: tuple[Finding, ...]) -> tuple[tuple[JointMotion, ...], str]:
    """Nothing is moved, and nobody wanted it."""
    return (), ""
