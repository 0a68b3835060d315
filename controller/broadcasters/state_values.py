"""Find the value of a state interface ``joint/interface`` in a measured joint state."""

import math
from collections.abc import Callable, Sequence
from typing import Final

from hal.robot_description.description import Mimic
from hal.types import JointState, ServoHealth

Reader = Callable[[JointState], float]
"""Function that returns a value from a joint state, or NaN if the value is unknown."""

MOVEMENT: Final = ("position", "velocity", "effort")
"""Interfaces of every JointState, in SI units."""

_OF_HEALTH: Final[dict[str, Callable[[ServoHealth], float]]] = {
    "temperature": lambda health: health.temperature_c,
    "voltage": lambda health: health.voltage_v,
    "load": lambda health: health.load,
    "current": lambda health: health.current_a,
    "alarms": lambda health: float(len(health.alarms)),
}
_COUNTERS: Final[dict[str, str]] = {
    "replies": "replies",
    "silent": "silent",
    "corrupt": "corrupt",
    "late": "late",
    "refused": "refused",
    "reset": "reset",
    "alarm_replies": "alarms",
    "retries": "retries",
    "skipped": "skipped",
    "implausible": "implausible",
}
SERVO: Final = (*_OF_HEALTH, "fault", *_COUNTERS)
"""Interfaces of a servo: its values (°C, V, fraction of full drive, A, number of alarms), its fault state (1 or 0) and
its bus counters.
"""


def reader(joint: str, interface: str, hardware_joints: Sequence[str], mimic: Mimic | None = None) -> Reader:
    """Return the reader for an interface of a joint. A mimic joint uses its source joint's position and velocity."""
    source = mimic.joint if mimic else joint
    if source in hardware_joints and interface in MOVEMENT:
        return _movement(interface, list(hardware_joints).index(source), mimic or Mimic(joint, 1.0, 0.0))
    if interface in SERVO:
        return _of_servo(source, interface)
    return _extra(f"{joint}/{interface}")


def _extra(key: str) -> Reader:
    return lambda state: state.extra.get(key, math.nan)


def _movement(interface: str, index: int, mimic: Mimic) -> Reader:
    factor, offset = mimic.multiplier, mimic.offset
    if interface == "position":
        return lambda state: float(state.position[index]) * factor + offset
    if interface == "velocity":
        return lambda state: float(state.velocity[index]) * factor
    return lambda state: float(state.effort[index])


def _of_servo(joint: str, interface: str) -> Reader:
    if interface == "fault":
        return lambda state: float(joint in state.faults)
    read, extra = _OF_HEALTH.get(interface) or _counter(_COUNTERS[interface]), _extra(f"{joint}/{interface}")

    def value(state: JointState) -> float:
        health = state.health.get(joint)
        return extra(state) if health is None else read(health)

    return value


def _counter(name: str) -> Callable[[ServoHealth], float]:
    return lambda health: math.nan if health.counters is None else float(getattr(health.counters, name))
