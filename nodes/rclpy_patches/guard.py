"""The guard around the patches of rclpy: on another rclpy the stack runs without them, and says what is lost.

A patch that does not fit may end the process that holds the arm's torque: layouts of C structures are written down in
it. So each is used on the versions only that it was tried on, and there only where it finds what it stands on.
"""

import logging
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Final

from nodes.rclpy_patches import cycle_executor, gil_release, type_service
from nodes.rclpy_patches.patch import Patch

LOG = logging.getLogger("servoloop.nodes")

PATCHES: Final = (gil_release.PATCH, cycle_executor.PATCH, type_service.PATCH)


def rclpy_version() -> str:
    """The version in rclpy's package; "" for a build without one."""
    try:
        return version("rclpy")
    except PackageNotFoundError:
        return ""


@cache
def usable_patches() -> frozenset[Patch]:
    """The patches that fit this rclpy, looked at once in a process; one warning names what is lost without the rest."""
    usable, warning = select(PATCHES, rclpy_version())
    if warning:
        LOG.warning("%s", warning)
    return usable


def select(patches: Iterable[Patch], found: str) -> tuple[frozenset[Patch], str]:
    """The patches that fit the version ``found``, and a warning for the others ("" where all fit)."""
    reasons = {patch: _reason(patch, found) for patch in patches}
    usable = frozenset(patch for patch, reason in reasons.items() if not reason)
    if not any(reasons.values()):
        return usable, ""
    why = ", ".join(dict.fromkeys(reason for reason in reasons.values() if reason))
    lost = "; ".join(patch.loss for patch, reason in reasons.items() if reason)
    return usable, f"{why}: plain rclpy is used instead of our patches, and everything works but for this: {lost}"


def _reason(patch: Patch, found: str) -> str:
    """Why the patch is not used, or ""."""
    if found not in patch.versions:
        return f"rclpy {found or 'of unknown version'} is not known here (known: {', '.join(sorted(patch.versions))})"
    try:
        return ", ".join(patch.differences())
    except Exception as error:  # whatever another rclpy, rcl or C library does when it is looked at
        return f"{patch.name} cannot be used on this rclpy: {error}"
