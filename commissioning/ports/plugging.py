"""Waiting for an adapter to be plugged in or pulled: which one was it?"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from commissioning.errors import CommissioningError
from commissioning.ports.adapters import Adapter, machine_complaints, ports
from commissioning.ports.machine import Machine
from drivers.clock import Clock, MonotonicClock

LOOK_S: Final = 0.1
SETTLE_S: Final = 1.0
"""udev gives a new device its group within this time, and brltty takes it away."""


@dataclass(frozen=True, slots=True)
class Plugged:
    """What has happened to which adapter. ``vanished``: it was there and is gone at once."""

    happened: Literal["plugged", "pulled", "vanished"]
    adapter: Adapter
    why: str = ""


def wait_for_plugging(timeout_s: float, machine: Machine | None = None, clock: Clock | None = None) -> Plugged:
    """Wait until an adapter comes or goes. Raises CommissioningError when none has until ``timeout_s`` from now."""
    machine, clock = machine or Machine(), clock or MonotonicClock()
    before = _adapters(machine)
    end_s = clock.now() + timeout_s
    while clock.now() < end_s:
        clock.sleep_until(min(clock.now() + LOOK_S, end_s))
        # Names alone: to look at all of an adapter ten times a second would be a waste.
        devices = {info.device for info in machine.comports()}
        if gone := sorted(before.keys() - devices):
            return Plugged("pulled", before[gone[0]])
        if devices - before.keys() and (new := _new(machine, before)):
            return _settled(machine, clock, new)
    raise CommissioningError(
        f"no adapter was plugged in or pulled within {timeout_s:g} s. One that was and does not show: try another "
        "cable (some only charge) and another socket"
    )


def _settled(machine: Machine, clock: Clock, new: Adapter) -> Plugged:
    """The new adapter, once the system has done with it what it does."""
    clock.sleep_until(clock.now() + SETTLE_S)
    now = _adapters(machine)
    if new.device in now:
        return Plugged("plugged", now[new.device])
    reasons = machine_complaints(machine, machine.udev_rules())
    return Plugged("vanished", new, str(reasons[0]) if reasons else "a loose plug, or a supply that is too weak")


def _new(machine: Machine, before: Mapping[str, Adapter]) -> Adapter | None:
    now = _adapters(machine)
    return next((one for device, one in now.items() if device not in before), None)


def _adapters(machine: Machine) -> dict[str, Adapter]:
    return {one.device: one for one in ports(machine).adapters}
