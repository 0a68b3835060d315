"""Select the patches that fit the installed rclpy.

Without a patch, the stack still runs, but with a limitation that it reports in a warning.

Patches depend on the layouts of C structures. An unsuitable patch could crash the process that controls the arm.
Each patch is therefore used only with the rclpy versions with which it was tested, and only if its checks find no
differences.
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
    """Return the version of the rclpy package, or "" if the build has no version."""
    try:
        return version("rclpy")
    except PackageNotFoundError:
        return ""


@cache
def usable_patches() -> frozenset[Patch]:
    """Return the patches that fit the installed rclpy. The first call in a process logs a warning about the patches
    that do not fit."""
    usable, warning = select(PATCHES, rclpy_version())
    if warning:
        LOG.warning("%s", warning)
    return usable


def select(patches: Iterable[Patch], found: str) -> tuple[frozenset[Patch], str]:
    """Return the patches that fit the version ``found``, and a warning about the patches that do not fit ("" if all
    fit)."""
    reasons = {patch: _reason(patch, found) for patch in patches}
    usable = frozenset(patch for patch, reason in reasons.items() if not reason)
    if not any(reasons.values()):
        return usable, ""
    why = ", ".join(dict.fromkeys(reason for reason in reasons.values() if reason))
    lost = "; ".join(patch.loss for patch, reason in reasons.items() if reason)
    return usable, f"{why}: the stack uses plain rclpy without these patches and has the following limitations: {lost}"


def _reason(patch: Patch, found: str) -> str:
    """Return the reason why a patch cannot be used, or "" if it can be used."""
    if found not in patch.versions:
        return (
            f"rclpy {found or 'of unknown version'} is not supported (supported: {', '.join(sorted(patch.versions))})"
        )
    try:
        return ", ".join(patch.differences())
    except Exception as error:  # A different rclpy, rcl or C library may raise any error.
        return f"{patch.name} cannot be used on this rclpy: {error}"
