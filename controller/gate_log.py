"""Log the safety gate's changes. Joints that the gate limits for the same reason in one cycle share one line."""

import logging
from collections.abc import Mapping

from hal.same_event import as_one, event_of
from hal.types import Interface

LOG = logging.getLogger("servoloop.controller")


def log_gate(reasons: Mapping[str, str]) -> None:
    """Log why the gate has changed commands.

    Args:
        reasons: Reason of each change, keyed by command interface. Reasons that differ only in their numbers count as
            one event.
    """
    events: dict[tuple[str, ...], list[str]] = {}
    for interface, reason in reasons.items():
        events.setdefault(event_of(reason), []).append(interface)
    for interfaces in events.values():
        names = ", ".join(_short_name(interface) for interface in interfaces)
        LOG.info("safety gate: %s: %s", names, as_one([reasons[interface] for interface in interfaces]))


def _short_name(interface: str) -> str:
    """Return the joint of a position interface, or the whole name of any other interface."""
    joint, kind = Interface.parse(interface)
    return joint if kind == "position" else interface
