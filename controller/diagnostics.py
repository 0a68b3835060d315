"""Build the diagnostics published on ``/diagnostics`` for the loop, controllers, components, servos and ports."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

from controller.loop import ControlLoop
from hal.components.component import Component
from hal.lifecycle import LifecycleState
from hal.types import JointState, ServoHealth

LOOP: Final = "servoloop: control loop"
CONTROLLERS: Final = "servoloop: controllers"
"""Name of the status whose values are the states of the controllers, keyed by controller name."""


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(slots=True)
class Status:
    """One diagnostic status, with the fields of diagnostic_msgs/DiagnosticStatus."""

    level: Level
    name: str
    message: str
    hardware_id: str
    values: dict[str, str] = field(default_factory=dict)


def statuses(
    loop: ControlLoop, hardware_id: str, servo_ids: Mapping[str, str], state: JointState | None
) -> Iterator[Status]:
    """Yield all statuses of a stack. Any thread may call this function.

    Args:
        loop: The stack's control loop.
        hardware_id: Hardware ID of the loop and the controllers.
        servo_ids: Servo ID of each joint, keyed by joint name. Empty if there are no servos.
        state: Latest measurement, or None before the first measurement.
    """
    yield _loop_status(loop, hardware_id)
    yield _controllers_status(loop, hardware_id)
    for component in loop.hardware.components:
        yield _component_status(component)
        for joint in component.hardware.joints:
            if state is not None and joint in servo_ids:
                yield _servo_status(state, joint, servo_ids[joint], component.name)
    for port, counters in state.lines.items() if state is not None else ():
        # These counters are not specific to a servo. A lost port is reported in the status of its component.
        values = _texts(noise=counters.noise, strange=counters.strange)
        yield Status(Level.OK, f"servoloop: {port}", "counted since the port was opened", port, values)


def _loop_status(loop: ControlLoop, hardware_id: str) -> Status:
    figures = loop.figures
    level = Level.WARN if figures.missed or figures.unmeasured else Level.OK
    values = _texts(
        rate_hz=f"{1.0 / loop.period_s:g}",
        cycles=figures.cycles,
        missed_cycles=figures.missed,
        unmeasured_cycles=figures.unmeasured,
        latest_wake_up_ms=f"{figures.latest_wake_up_s * 1e3:.3f}",
        longest_cycle_ms=f"{figures.longest_cycle_s * 1e3:.3f}",
        mean_cycle_ms=f"{figures.busy_s / max(1, figures.cycles) * 1e3:.3f}",
    )
    kept_hz = figures.recent.kept_hz
    if kept_hz is not None:
        values["kept_rate_hz"] = f"{kept_hz:g}"
    return Status(level, LOOP, figures.summary, hardware_id, values)


def _controllers_status(loop: ControlLoop, hardware_id: str) -> Status:
    """Return the status of all controllers. The level is always OK, because an inactive controller is not an error."""
    loaded = loop.manager.registry.loaded
    active = sum(entry.active for entry in loaded.values())
    states = {name: entry.state.name.lower() for name, entry in loaded.items()}
    return Status(Level.OK, CONTROLLERS, f"{active} of {len(loaded)} active", hardware_id, states)


def _component_status(component: Component) -> Status:
    name, error = component.name, component.error  # The loop thread may clear the error at any time.
    if error is not None:
        text = f"lost: {error}. Fix the cause, then activate the component again"
        return Status(Level.ERROR, f"servoloop: {name}", text, name)
    level = Level.OK if component.state is LifecycleState.ACTIVE else Level.WARN
    return Status(level, f"servoloop: {name}", component.state.name.lower(), name)


def _servo_status(state: JointState, joint: str, servo_id: str, component: str) -> Status:
    status = Status(Level.OK, f"servoloop: {joint} (servo {servo_id})", "ok", f"{component}/{servo_id}")
    health = state.health.get(joint)
    if health is not None:
        status.values = _texts(voltage_v=f"{health.voltage_v:.1f}", temperature_c=f"{health.temperature_c:.0f}")
        if not math.isnan(health.current_a):
            status.values |= _texts(current_a=f"{health.current_a:.2f}")
        if health.counters is not None:
            status.values |= _texts(**health.counters.as_dict())
        status.level, status.message = health_status(health)
    if joint in state.faults:
        status.level, status.message = Level.ERROR, state.faults[joint].text
    return status


def health_status(health: ServoHealth) -> tuple[Level, str]:
    """Return the level and the message that describe a servo's health."""
    supply = health.supply
    wrong = [f"alarm: {', '.join(health.alarms)}"] if health.alarms else []
    wrong += [f"{supply.kind}: the servo {supply.text}"] if supply else []
    wrong += [health.stall.text] if health.stall and health.stall.warns else []
    level = Level.ERROR if supply and supply.outside else Level.WARN if wrong else Level.OK
    return level, "; ".join(wrong) or (health.stall.text if health.stall else "ok")


def _texts(**values: object) -> dict[str, str]:
    return {key: str(value) for key, value in values.items()}
