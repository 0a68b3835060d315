"""Log the safety gate's changes. Joints that the gate stops for the same reason in one cycle share one line."""

import logging
from collections.abc import Mapping

from hal.same_event import as_one, event_of

LOG = logging.getLogger("servoloop.controller")


def log_gate(reasons: Mapping[str, str]) -> None:
    """Log why the gate has changed commands.

    Args:
        reasons: Reason of each change, by command interface. Reasons that differ only in their numbers are one event.
    """
    events: dict[tuple[str, ...], list[str]] = {}
    for interface, reason in reasons.items():
        events.setdefault(event_of(reason), []).append(interface)
    for interfaces in events.values():
        names = ", ".join(interface.removesuffix("/position") for interface in interfaces)
        LOG.info("safety gate: %s: %s", names, as_one([reasons[interface] for interface in interfaces]))
