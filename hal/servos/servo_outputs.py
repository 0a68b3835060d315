"""Outputs and inputs in servo registers: the LED, and the external ports of a Dynamixel.

An output is sent when its value changes, with a packet that is not acknowledged, so that no cycle waits for a reply. At
most one output is sent and one input is read per cycle.
"""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from drivers.servos.catalog import registers_of
from drivers.servos.register import Access, Register
from hal.hal_errors import RobotFileError
from hal.joint import Joint
from hal.outputs import Outputs
from hal.robot_description.hardware_info import HardwareInfo
from hal.robot_description.outputs import OutputInfo
from hal.robot_description.servo_sensors import SERVO_INPUTS
from hal.servos.joint_buses import JointBuses
from hal.types import Interface

LOG = logging.getLogger("servoloop.hal")

ALLOWED: Final = ("led", *SERVO_INPUTS)
"""Registers that may be outputs. They neither move the servo nor change its torque or EEPROM."""
INPUT_PERIOD_S: Final = 0.1
"""Time between two reads of the same input, in seconds."""


class ServoOutputs:
    """Outputs and inputs of one component with servos."""

    def __init__(self, component: HardwareInfo, joints: Sequence[Joint], outputs: Outputs) -> None:
        """Prepare the outputs.

        Args:
            component: The ``<ros2_control>`` block.
            joints: Joints of the component.
            outputs: Values requested by controllers.

        Raises:
            RobotFileError: A register cannot be an output or an input.
        """
        by_name = {joint.name: joint for joint in joints}
        if problems := [*output_problems(component, by_name), *_input_problems(component, by_name)]:
            raise RobotFileError("\n".join(problems))
        self.names = tuple(component.outputs)
        self._targets = {name: _target(by_name[info.joint], name) for name, info in component.outputs.items()}
        self._inputs = {
            f"{name}/{kind}": _target(by_name[sensor.joint], kind)
            for name, sensor in component.sensors.items()
            for kind in sensor.interfaces
            if kind in SERVO_INPUTS and f"{name}/{kind}" not in component.outputs
        }
        self._outputs = outputs
        self._sent: dict[str, int] = {}
        self._due = [*self._inputs]
        self._next_s = -math.inf
        self.values: Mapping[str, float] = {}
        """Values of the state interfaces, keyed by name (``lamp/led``). The control loop replaces the mapping instead
        of changing it."""

    @property
    def has_inputs(self) -> bool:
        """Whether the component has any inputs."""
        return bool(self._inputs)

    def forget(self) -> None:
        """Send all outputs again, because the servos may have been reset."""
        self._sent = {}

    def send(self, buses: JointBuses) -> None:
        """Send one output whose value has changed."""
        for name, (joint, register) in self._targets.items():
            value = self._outputs.requested(name)
            if value is None:
                continue
            raw = min(max(round(value), register.smallest), register.largest)
            if self._sent.get(name) != raw:
                with buses.named(joint.bus):
                    buses.buses[joint.bus].write_unacknowledged(joint.servo_id, register, raw)
                self._sent[name] = raw
                self.values = {**self.values, name: float(raw)}
                return

    def read(self, buses: JointBuses, now_s: float, deadline_s: float) -> None:
        """Read one input if it is due and there is enough time. An input whose servo does not respond keeps its
        value."""
        if not self._inputs or (now_s < self._next_s and len(self._due) == len(self._inputs)):
            return
        if len(self._due) == len(self._inputs):
            self._next_s = now_s + INPUT_PERIOD_S
        name = self._due.pop()
        self._due = self._due or [*self._inputs]
        joint, register = self._inputs[name]
        with buses.named(joint.bus):
            found = buses.buses[joint.bus].read_registers({joint.servo_id: register}, deadline_s)
        if joint.servo_id in found:
            self.values = {**self.values, name: float(found[joint.servo_id])}


def output_problems(component: HardwareInfo, joints: Mapping[str, Joint]) -> Iterator[str]:
    """Yield a message for each output that the servos of a component do not have."""
    for name, info in component.outputs.items():
        if info.joint not in joints:
            yield f'the output {name} ({info.place}) has no servo: specify a joint in <param name="joint">'
        elif reason := _why_not_output(joints[info.joint], Interface.parse(name).kind, info):
            yield reason


def _why_not_output(joint: Joint, kind: str, info: OutputInfo) -> str:
    """Return the reason why a register cannot be an output, or an empty string."""
    subject = f"{info.joint}: the command_interface {kind} ({info.place})"
    has = ", ".join(name for name in ALLOWED if _register(joint, name)) or "none"
    remedy = f"use one of its outputs ({has}), or remove the interface"
    register = _register(joint, kind)
    if register is None:
        return f"{subject} is not a register of its {joint.model.name}: {remedy}"
    if register.access is Access.READ:
        return f"{subject} is a register that cannot be written: {remedy}"
    if register.persistent:
        return f"{subject} is in the EEPROM, which wears out: {remedy}"
    if kind not in ALLOWED:
        return f"{subject} is a register that moves the servo or changes how it holds: {remedy}"
    return ""


def _input_problems(component: HardwareInfo, joints: Mapping[str, Joint]) -> Iterator[str]:
    for name, sensor in component.sensors.items():
        for kind in sensor.interfaces:
            if kind in SERVO_INPUTS and sensor.joint in joints and _register(joints[sensor.joint], kind) is None:
                model = joints[sensor.joint].model.name
                yield f"{name}: the servo of {sensor.joint}, an {model}, has no {kind} ({sensor.place}): remove it"


def _register(joint: Joint, name: str) -> Register | None:
    return next((one for one in registers_of(joint.model) if one.name == name), None)


def _target(joint: Joint, name: str) -> tuple[Joint, Register]:
    register = _register(joint, Interface.parse(name).kind if "/" in name else name)
    assert register is not None
    return joint, register
