"""Stacks for the tests of the trajectory controller, with a client in the process of the test."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import rclpy

from hal.robot_description.description import parse_urdf
from nodes.namespace import namespace_arguments
from servoloop.stack.shipped_files import CONTROLLERS, URDF
from tests.ros.stack_process import running
from tests.ros.trajectory_client import NONE, TrajectoryClient

MOCK = ("--hardware", "mock")
PERIOD_S = 0.05
"""Constraints of the arm in the default controllers file."""
FASTEST_RAD_S = max(joint.velocity for joint in parse_urdf(URDF.read_text()).joints.values())
LARGEST_STEP_RAD = 1.001 * FASTEST_RAD_S * PERIOD_S


@contextmanager
def client_of(folder: Path, *arguments: str, namespace: str = "") -> Iterator[TrajectoryClient]:
    """Run ``servoloop up`` with these arguments in a namespace, and yield its client."""
    with running(folder, *arguments, "--namespace", namespace) as stack:
        rclpy.init(args=namespace_arguments(namespace))
        client = TrajectoryClient(stack)
        try:
            yield client
        finally:
            client.close()
            rclpy.try_shutdown()


@contextmanager
def plain_client(
    folder: Path, *extra_lines: str, initial_rad: Mapping[str, float] = NONE, **hardware: str
) -> Iterator[TrajectoryClient]:
    """Run a stack with a ros2_control controllers file and no robot file. It uses splines."""
    urdf = mock_urdf(folder, initial_rad, **hardware)
    with client_of(folder, *MOCK, "--urdf", urdf, "--controllers", controllers_file(folder, *extra_lines)) as client:
        yield client


def controllers_file(folder: Path, *extra_lines: str) -> str:
    """Write the arm's controllers file without tolerances and with extra lines for its controller."""
    text = CONTROLLERS.read_text()
    tolerances = r"(?:    # [^\n]*\n)*    constraints:(?s:.*?)(?=\nhand_controller)"
    text, count = re.subn(rf" +allow_nonzero_velocity_at_trajectory_end: true\n|{tolerances}", "", text)
    assert count == 2
    mark = "    state_interfaces: [position, velocity]\n"
    assert mark in text
    (folder / "controllers.yaml").write_text(
        text.replace(mark, mark + "".join(f"    {line}\n" for line in extra_lines))
    )
    return str(folder / "controllers.yaml")


def mock_urdf(folder: Path, initial_rad: Mapping[str, float], **parameters: str) -> str:
    """Write a URDF of the arm on GenericSystem, as in ros2_control. joint6 is continuous."""
    robot = ElementTree.parse(URDF)
    hardware = robot.find("ros2_control/hardware")
    assert hardware is not None
    hardware.clear()
    ElementTree.SubElement(hardware, "plugin").text = "mock_components/GenericSystem"
    for name, value in {"calculate_dynamics": "true", **parameters}.items():
        ElementTree.SubElement(hardware, "param", name=name).text = value
    for name, position_rad in initial_rad.items():
        state = robot.find(f"ros2_control/joint[@name='{name}']/state_interface[@name='position']")
        assert state is not None
        ElementTree.SubElement(state, "param", name="initial_value").text = str(position_rad)
    joint = next(j for j in robot.findall("joint") if j.get("name") == "joint6")
    joint.set("type", "continuous")
    robot.write(folder / "arm.urdf")
    return str(folder / "arm.urdf")


def case(name: str, *values: Any, rows: Sequence[str]) -> Any:
    """A row of a test table, with the rows of the specification that it tests."""
    return pytest.param(*values, id=name, marks=pytest.mark.row(*rows))


def rises(path: Sequence[float]) -> bool:
    """Return whether a path never turns back. Differences of rounding, about 1e-18 near zero, do not count."""
    rounded = [round(place, 9) for place in path]
    return rounded == sorted(rounded)


def largest_step_rad(states: Sequence[Any], of: str = "feedback") -> float:
    """Return the largest step of any joint between two cycles.

    ``feedback`` is the limited position of the mock. ``output`` is the desired position, which deviates slightly if a
    cycle was late.
    """
    path = [getattr(state, of).positions for state in states]
    return max(abs(b - a) for one, other in pairwise(path) for a, b in zip(one, other, strict=True))
