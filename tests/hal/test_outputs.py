"""Outputs of ``<gpio>`` elements: registers of servos, and any interface of a mock."""

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.broadcasters.joint_state_broadcaster import BroadcasterParameters, JointStateBroadcaster
from controller.forward.commands import ForwardParameters
from controller.forward.forward_command_controller import ForwardCommandController
from drivers.servos import x
from drivers.servos.catalog import MODELS
from drivers.servos.register import Register
from hal.components.component_lifecycle import activate_all, configure_all
from hal.components.component_set import ComponentSet
from hal.hal_errors import HalError
from hal.mock_hardware import MockHardware
from hal.outputs import Outputs
from hal.robot_description.description import HardwareInfo, parse_urdf
from hal.robot_description.outputs import OutputInfo
from hal.robot_description.servo_sensors import SensorInfo
from hal.servos.servo_outputs import ServoOutputs
from hal.types import JointCommand
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files
from sim_backend.clock import SimulatedClock

SOURCE = '<param name="joint">gripper</param>'
LED = f'<gpio name="lamp">{SOURCE}<command_interface name="led"/><state_interface name="led"/></gpio>'


def with_elements(folder: Path, elements: str, name: str = "koch") -> Files:
    """Read an arm with further elements in its ``<ros2_control>`` block."""
    arm = find_arm(name)
    urdf = folder / "arm.urdf"
    urdf.write_text(arm.urdf.read_text().replace("</ros2_control>", f"{elements}</ros2_control>"))
    return read_arm_files(arm, urdf, robot=arm.robot)


def test_a_forward_controller_switches_the_led_of_a_servo_and_its_state_is_reported(tmp_path: Path) -> None:
    files = with_elements(tmp_path, LED)
    stack = SimulatedStack(files=files).up()
    context = stack.control_stack.context
    parameters = ForwardParameters(joints=("lamp",), interface_name="led")
    controller: Any = ForwardCommandController.build("lamp_controller", parameters, context)
    registry = stack.loop.manager.registry
    registry.add(controller)
    stack.loop.manager.activate_each(["lamp_controller"], stack.loop.hardware.read(), stack.loop.within_limits)
    assert registry.claimed["lamp/led"] == "lamp_controller"
    broadcaster = JointStateBroadcaster.build("b", BroadcasterParameters(), context)
    before, bus = stack.loop.command.copy(), next(iter(stack.made[0]._opened("read").buses.values()))
    for value in (1.0, 7.0, 0.0):
        assert controller.submit([value]) is None
        stack.run(0.2)
        reported = dict(zip(broadcaster.interfaces, broadcaster.values(stack.loop.hardware.read()), strict=True))
        assert reported["lamp"] == [float(bool(value))]
        assert bus.read(stack.files.robot.file.joints["gripper"].servo_id, x.led) == bool(value)
    assert stack.loop.command == pytest.approx(before, abs=0.02), "an output moves no joint"


def test_an_output_is_sent_again_after_its_servo_was_reset(tmp_path: Path) -> None:
    stack = SimulatedStack(files=with_elements(tmp_path, LED)).up()
    servo = stack.bus.servo(stack.files.robot.file.joints["gripper"].servo_id)
    stack.control_stack.context.outputs.set("lamp/led", 1.0)
    stack.run(0.2)
    assert servo.memory.get(x.led) == 1
    servo.power_cycle()
    stack.run(1.0)
    assert servo.memory.get(x.led) == 0
    assert stack.hardware.reactivate() == {"gripper"}
    stack.run(0.2)
    assert servo.memory.get(x.led) == 1


@pytest.mark.parametrize(
    ("register", "reason"),
    [
        ("goal_position", "goal_position .* is a register that moves the servo or changes how it holds"),
        ("torque_enable", "torque_enable .* is a register that moves the servo or changes how it holds"),
        ("profile_velocity", "profile_velocity .* moves the servo or changes how it holds"),
        ("homing_offset", "homing_offset .* is in the EEPROM, which wears out"),
        ("present_position", "present_position .* is a register that cannot be written"),
        ("Goal Position", r"gripper: the command_interface Goal Position .* is not a register of its .*\(led\)"),
    ],
)
def test_registers_that_move_a_servo_are_refused_by_name(register: str, reason: str, tmp_path: Path) -> None:
    files = with_elements(tmp_path, f'<gpio name="a">{SOURCE}<command_interface name="{register}"/></gpio>')
    with pytest.raises(HalError, match=reason):
        SimulatedStack(files=files).up()


def test_an_output_without_a_servo_is_refused(tmp_path: Path) -> None:
    files = with_elements(tmp_path, '<gpio name="a"><command_interface name="led"/></gpio>')
    with pytest.raises(HalError, match=r'the output a/led .* has no servo: specify a joint in <param name="joint">'):
        SimulatedStack(files=files).up()


class PortsBus:
    """Bus with one servo, whose first external port has a voltage, and whose second port never answers."""

    def __init__(self) -> None:
        self.written: list[tuple[str, int]] = []

    def read_registers(self, registers: dict[int, Register], deadline_s: float) -> dict[int, int]:
        return {i: 2048 for i, register in registers.items() if register.name == "external_port_data_1"}

    def write_unacknowledged(self, servo_id: int, register: Register, value: int) -> None:
        self.written.append((register.name, value))


def test_external_ports_are_read_one_in_a_cycle_and_written_when_they_change() -> None:
    joint = SimpleNamespace(name="lift", model=MODELS["xm540-w270"], servo_id=1, bus="arm")
    sensor = SensorInfo("lift", ("external_port_data_1", "external_port_data_2"))
    output = {"pump/external_port_data_3": OutputInfo("lift", 0.0, 1.0)}
    component = HardwareInfo("arm", "system", "", {}, {}, {}, sensors={"ports": sensor}, outputs=output)
    requested, bus = Outputs(output), PortsBus()
    ports = ServoOutputs(component, [joint], requested)
    buses = SimpleNamespace(buses={"arm": bus}, named=lambda name: nullcontext())
    for cycle in range(4):
        ports.read(buses, 0.05 * cycle, 0.05 * cycle + 0.01)
        ports.send(buses)
        requested.set("pump/external_port_data_3", 9.0)
    assert ports.values == {"ports/external_port_data_1": 2048.0, "pump/external_port_data_3": 1.0}
    assert bus.written == [("external_port_data_3", 1)]


def test_a_servo_without_external_ports_is_refused(tmp_path: Path) -> None:
    files = with_elements(tmp_path, f'<gpio name="a">{SOURCE}<state_interface name="external_port_data_1"/></gpio>')
    with pytest.raises(HalError, match="a: the servo of gripper, an xl330-m288, has no external_port_data_1"):
        SimulatedStack(files=files).up()


def test_a_mock_has_every_output_and_reports_it() -> None:
    """URDFs for other drivers declare grippers and registers as ``<gpio>`` interfaces with any name."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="lift" type="continuous"><parent link="a"/>'
        '<child link="b"/><limit velocity="1" effort="1"/></joint>'
        '<ros2_control name="arm" type="system"><hardware><plugin>p/P</plugin></hardware>'
        '<joint name="lift"><command_interface name="position"/><command_interface name="acceleration"/>'
        '<state_interface name="position"/><state_interface name="acceleration"/></joint>'
        '<gpio name="tool"><command_interface name="vacuum"/><state_interface name="vacuum"/></gpio>'
        "</ros2_control></robot>"
    )
    component = parse_urdf(text).components[0]
    assert tuple(component.outputs) == ("lift/acceleration", "tool/vacuum")
    requested = Outputs(component.outputs)
    mock = MockHardware.of(component, SimulatedClock(), requested)
    mock.configure()
    mock.activate()
    requested.set("tool/vacuum", 1.0)
    requested.set("lift/acceleration", 0.5)
    mock.write(JointCommand(np.zeros(1), 0.05))
    assert mock.read().extra == {"tool/vacuum": 1.0, "lift/acceleration": 0.5}


def test_a_mock_of_only_outputs_reports_them() -> None:
    text = (
        '<robot name="r"><link name="a"/><ros2_control name="box" type="system">'
        "<hardware><plugin>p/P</plugin></hardware>"
        '<gpio name="lamp"><command_interface name="led"/><state_interface name="led"/></gpio></ros2_control></robot>'
    )
    component, clock = parse_urdf(text).components[0], SimulatedClock()
    requested = Outputs(component.outputs)
    components = ComponentSet([MockHardware.of(component, clock, requested)], clock)
    configure_all(components)
    activate_all(components)
    requested.set("lamp/led", 1.0)
    components.read()
    components.write(np.zeros(0), 0.05)
    assert components.read().extra == {"lamp/led": 1.0}


def test_an_output_has_no_effect_in_mujoco_but_its_controller_starts(tmp_path: Path) -> None:
    stack = SimulatedStack(files=with_elements(tmp_path, LED), wire=False)
    parameters = ForwardParameters(joints=("lamp",), interface_name="led")
    stack.add_controller(ForwardCommandController.build("lamp", parameters, stack.control_stack.context))
    stack.up()
    stack.run(0.2)
    assert stack.manager.registry.claimed["lamp/led"] == "lamp"
