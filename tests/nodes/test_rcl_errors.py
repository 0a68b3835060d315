"""Errors of rcl and in arguments are reported in one sentence, and errors in our code keep their traceback."""

from pathlib import Path
from typing import Any

import pytest

from nodes.ros_environment import RosError

rclpy = pytest.importorskip("rclpy")


def refused(error: Exception) -> str:
    from nodes.ros_process import rcl_errors

    with pytest.raises(RosError) as caught, rcl_errors():
        raise error
    return str(caught.value)


@pytest.fixture
def rcl() -> Any:
    from rclpy.impl.implementation_singleton import rclpy_implementation

    return rclpy_implementation


@pytest.mark.parametrize(
    "name", ["RCLError", "RCLInvalidROSArgsError", "RCUtilsError", "RMWError", "UnknownROSArgsError"]
)
def test_error_of_rcl_becomes_a_sentence(rcl: Any, name: str) -> None:
    text = refused(getattr(rcl, name)("no such thing, at /home/me/rcl/src/rcl/init.c:1"))
    assert text.startswith("ROS 2 does not start: ") and "no such thing" in text and "/home/me" not in text


def test_invalid_name_becomes_a_sentence() -> None:
    from rclpy.exceptions import InvalidNodeNameException

    text = refused(InvalidNodeNameException("an arm", "must not contain a space", 2))
    assert text == "ROS 2 does not start: Invalid node name: must not contain a space: 'an arm'"


@pytest.mark.parametrize("kind", ["plain", "InvalidHandle", "NotImplementedError"])
def test_error_in_our_code_is_not_converted(rcl: Any, kind: str) -> None:
    from nodes.ros_process import rcl_errors

    error = RuntimeError("dictionary changed size") if kind == "plain" else getattr(rcl, kind)("a defect")
    with pytest.raises(type(error)) as caught, rcl_errors():
        raise error
    assert caught.value is error


def test_unreadable_parameters_become_a_sentence(tmp_path: Path) -> None:
    from nodes.ros_process import init_rclpy

    file = tmp_path / "parameters.yaml"
    file.write_text("node:\n  ros__parameters:\n    pose: [0, -0.35]\n")
    with pytest.raises(RosError, match=r"Sequence should be of same type.*write each number of the list with a decim"):
        init_rclpy(["--ros-args", "--params-file", str(file)])
    with pytest.raises(RosError, match=r"^ROS 2 does not start: .*nonsense"):
        init_rclpy(["--ros-args", "-p", "nonsense"])


def test_unknown_arguments_of_a_node_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    from nodes.ros_process import read_network_option

    with pytest.raises(SystemExit) as ended:
        read_network_option(["node.py", "--netwrok", "--params-file", "a.yaml"], "node", "Sort.", "let others send")
    assert ended.value.code == 2
    text = "node: error: unknown arguments: --netwrok --params-file a.yaml (parameters and other ROS arguments follow"
    assert text in capsys.readouterr().err
    read_network_option(["node.py", "--ros-args", "-p", "a:=1"], "node", "Sort.", "let others send")
