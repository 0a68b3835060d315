"""Wait until an adapter is plugged in or unplugged, and report that adapter."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from commissioning.commissioning_errors import CommissioningError
from commissioning.ports.adapters import Adapter, machine_complaints, ports
from commissioning.ports.machine import Machine
from drivers.clock import Clock, MonotonicClock

LOOK_S: Final = 0.1
SETTLE_S: Final = 1.0
"""Maximum time until udev sets the group of a new device or brltty removes the device, in seconds."""


@dataclass(frozen=True, slots=True)
class Plugged:
    """An adapter that was plugged in or unplugged."""

    happened: Literal["plugged", "pulled", "vanished"]
    """Kind of event. ``vanished`` means that a new adapter's port disappeared immediately."""
    adapter: Adapter
    why: str = ""
    """Reason why the port disappeared."""


def wait_for_plugging(timeout_s: float, machine: Machine | None = None, clock: Clock | None = None) -> Plugged:
    """Wait until an adapter is plugged in or unplugged. Raises CommissioningError after ``timeout_s``."""
    machine, clock = machine or Machine(), clock or MonotonicClock()
    before = _adapters(machine)
    end_s = clock.now() + timeout_s
    while clock.now() < end_s:
        clock.sleep_until(min(clock.now() + LOOK_S, end_s))
        # Examining all adapters completely ten times a second would be wasteful.
        devices = {info.device for info in machine.comports()}
        if gone := sorted(before.keys() - devices):
            return Plugged("pulled", before[gone[0]])
        if devices - before.keys() and (new := _new(machine, before)):
            return _settled(machine, clock, new)
    raise CommissioningError(
        f"no adapter was plugged in or unplugged within {timeout_s:g} s. If you plugged in an adapter, try a "
        f"different cable (some cables only charge) and a different USB socket"
    )


def _settled(machine: Machine, clock: Clock, new: Adapter) -> Plugged:
    """Return the event for a new adapter, after the system has configured the adapter."""
    clock.sleep_until(clock.now() + SETTLE_S)
    now = _adapters(machine)
    if new.device in now:
        return Plugged("plugged", now[new.device])
    reasons = machine_complaints(machine, machine.udev_rules())
    return Plugged("vanished", new, str(reasons[0]) if reasons else "a loose plug or a weak supply")


def _new(machine: Machine, before: Mapping[str, Adapter]) -> Adapter | None:
    now = _adapters(machine)
    return next((one for device, one in now.items() if device not in before), None)


def _adapters(machine: Machine) -> dict[str, Adapter]:
    return {one.device: one for one in ports(machine).adapters}
