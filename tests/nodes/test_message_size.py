"""The size of a C message equals the sum of its parts in Python, for all kinds of fields."""

import ctypes
from typing import Any

import pytest

pytest.importorskip("rclpy")

from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from controller_manager_msgs.srv import ListControllers, SwitchController
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Transform
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout, String
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectoryPoint

from nodes.rclpy_patches.message_size import capsule_address, layout_of

HUGE = 10**12
SEQUENCE, POINT = 24, 104


def measured(message: Any, allowed: int = HUGE) -> int:
    """Convert a message to C and return its size minus the fixed size of its type."""
    kind = type(message)
    layout = layout_of(kind)
    create = ctypes.PYFUNCTYPE(ctypes.c_void_p)(capsule_address(kind._CREATE_ROS_MESSAGE))
    destroy = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(capsule_address(kind._DESTROY_ROS_MESSAGE))
    convert = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)
    raw = create()
    try:
        convert(capsule_address(kind._CONVERT_FROM_PY))(message, raw)
        return layout.measured(raw, allowed) - layout.size
    finally:
        destroy(raw)


def goal(points: int, joints: int = 0, **more: Any) -> Any:
    request = FollowJointTrajectory.Impl.SendGoalService.Request()
    request.goal = FollowJointTrajectory.Goal(**more)
    point = JointTrajectoryPoint(positions=[0.0] * joints, velocities=[0.0] * joints)
    request.goal.trajectory.points = [point] * points
    return request


GRID = MultiArrayLayout(dim=[MultiArrayDimension(label="four")])
PARAMETER = Parameter(name="four", value=ParameterValue(string_array_value=["a", "bc"], double_array_value=[1.0]))
STATUS = DiagnosticStatus(name="ab", values=[KeyValue(key="k", value="vw"), KeyValue()])
MANY_AXES = MultiDOFJointTrajectoryPoint(transforms=[Transform()] * 3)


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (String(), 0),
        (String(data="ä" * 5), 10),
        (Float64MultiArray(data=[0.0] * 7), 56),
        (Float64MultiArray(layout=GRID, data=[0.0]), 32 + 4 + 8),
        (goal(0), 0),
        (goal(5), 5 * POINT),
        (goal(5, 6), 5 * (POINT + 2 * 6 * 8)),
        (goal(0, path_tolerance=[JointTolerance(name="joint")] * 2), 2 * (48 + 5)),
        (SetParameters.Request(parameters=[PARAMETER]), layout_of(Parameter).size + 4 + 2 * SEQUENCE + 3 + 8),
        (DiagnosticArray(status=[STATUS] * 2), 2 * (layout_of(DiagnosticStatus).size + 2 + 2 * 2 * SEQUENCE + 3)),
        (SwitchController.Request(activate_controllers=["a", "bc"]), 2 * SEQUENCE + 3),
        (ListControllers.Request(), 0),
        (MANY_AXES, 3 * 56),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, int) else str(value),
)
def test_message_is_as_large_as_its_parts(message: Any, expected: int) -> None:
    assert measured(message) == expected


@pytest.mark.parametrize("points", [1_000, 200_000])
def test_measuring_stops_when_a_message_is_too_large(points: int) -> None:
    request = goal(points, 6)
    whole = points * (POINT + 2 * 6 * 8)
    assert measured(request) == whole
    assert measured(request, allowed=2_000_000) == min(whole, points * POINT if whole > 2_000_000 else whole)
