"""Log changes made by the safety gate. Joints that the gate limits for the same reason in one cycle share one log
line."""

import logging
from collections.abc import Mapping

from hal.same_event import as_one, event_of
from hal.types import Interface

LOG = logging.getLogger("servoloop.controller")


def log_gate(reasons: Mapping[str, str]) -> None:
    """Log why the gate changed commands.

    Args:
        reasons: Reason for each change, keyed by command interface. Reasons that differ only in their numbers are
            logged as one event, but not those with different limits.
    """
    events: dict[tuple[str, ...], list[str]] = {}
    for interface, reason in reasons.items():
        limits = reason.partition(" outside the limits ")[2]
        events.setdefault((*event_of(reason), limits), []).append(interface)
    for interfaces in events.values():
        names = ", ".join(_short_name(interface) for interface in interfaces)
        LOG.info("safety gate: %s: %s", names, as_one([reasons[interface] for interface in interfaces]))


def _short_name(interface: str) -> str:
    """Return the joint name for a position interface, or the full name for any other interface."""
    joint, kind = Interface.parse(interface)
    return joint if kind == "position" else interface
