"""Tests of the conversion between YAML and messages for the command ``ros2``."""

import pytest

pytest.importorskip("rclpy")

import yaml
from apple_quality_msgs.msg import AppleQuality, AppleQualityArray
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from geometry_msgs.msg import PoseWithCovariance
from hypothesis import given
from hypothesis import strategies as st
from moveit_msgs.msg import CollisionObject
from std_msgs.msg import Float64MultiArray, String

from servoloop_ros2.ros2_error import Ros2Error
from servoloop_ros2.values import as_yaml, fill, find_type, read_values

NOW = Time(sec=5, nanosec=7)


def test_header_auto_has_the_present_time() -> None:
    message = AppleQualityArray()
    fill(message, read_values("{header: auto, apples: [{grade: A, diameter_mm: 62}]}"), NOW)
    assert message.header.stamp == NOW
    assert message.apples == [AppleQuality(grade="A", diameter_mm=62.0)]


def test_nested_messages_and_integers_in_lists_of_decimals() -> None:
    goal = FollowJointTrajectory.Goal()
    values = "{trajectory: {joint_names: [a], points: [{positions: [1], time_from_start: {sec: 2}}]}}"
    fill(goal, read_values(values), NOW)
    (point,) = goal.trajectory.points
    assert (list(point.positions), point.time_from_start.sec) == ([1.0], 2)


@given(st.lists(st.floats(width=64, allow_nan=False), max_size=5))
def test_every_list_of_numbers_survives_the_way_to_yaml_and_back(data: list[float]) -> None:
    message, again = Float64MultiArray(data=data), Float64MultiArray()
    fill(again, yaml.safe_load(as_yaml(message)), NOW)
    assert again == message


@pytest.mark.parametrize("message", [CollisionObject(id="box", operation=b"\x01"), PoseWithCovariance()])
def test_every_kind_of_field_survives_the_way_to_yaml_and_back(message: object) -> None:
    again = type(message)()
    fill(again, yaml.safe_load(as_yaml(message)), NOW)
    assert again == message


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ("{dato: x}", "String has no field dato; its fields: data"),
        ("[1]", "must be fields of the message"),
        ("{data: [", "not YAML"),
    ],
)
def test_wrong_values_are_refused_with_the_reason(values: str, part: str) -> None:
    with pytest.raises(Ros2Error, match=part):
        fill(String(), read_values(values), NOW)


def test_wrong_type_of_a_value_names_the_field() -> None:
    with pytest.raises(Ros2Error, match=r"AppleQuality.diameter_mm is of type float, not 'wide'"):
        fill(AppleQuality(), {"diameter_mm": "wide"}, NOW)


@pytest.mark.parametrize("name", ["std_msgs/msg/Nope", "nope/msg/String", "String", "std_msgs/srv/String"])
def test_unknown_types_are_refused(name: str) -> None:
    with pytest.raises(Ros2Error, match="type"):
        find_type(name, "msg")
    assert find_type("std_msgs/String", "msg") is String
