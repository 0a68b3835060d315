"""A missing, different or badly configured ROS 2 installation is reported in one sentence."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from nodes import vision_pick_place_controller
from nodes.ros_environment import PACKAGES, require_ros
from tests.complaint import complaint

VERBS = [["up", "--hardware", "mock"], ["pick", "B"], ["demo", "--grades", "A"]]


@pytest.mark.parametrize("package", ["rclpy", "control_msgs", "sorting_arm_interfaces"])
@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
def test_missing_package_is_named(
    verb: list[str], package: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if verb[0] == "up" and package == "rclpy":
        pytest.skip("up then runs without ROS: tests/servoloop/test_up_without_ros.py")
    for name in PACKAGES:
        monkeypatch.setitem(sys.modules, name, sys.modules.get(name, sys))
    monkeypatch.setitem(sys.modules, package, None)
    output = complaint(capsys, monkeypatch, *verb)
    assert f"ROS 2 Jazzy is required, but Python cannot find {package}: run 'make setup'" in output


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
def test_another_distribution_is_refused(
    verb: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder of a sourced distribution precedes the installed packages on the path."""
    pytest.importorskip("rclpy")
    info = tmp_path / "rclpy-9.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rclpy\nVersion: 9.1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    output = complaint(capsys, monkeypatch, *verb)
    assert "ROS 2 Jazzy (rclpy 7.1.x) is required, but Python finds rclpy 9.1.0: open a shell" in output


SETTINGS = [
    ("ROS_DOMAIN_ID", "abc", "ROS_DOMAIN_ID must be 0 to 232, not 'abc': correct or unset it"),
    ("ROS_DOMAIN_ID", "233", "ROS_DOMAIN_ID must be 0 to 232, not '233': correct or unset it"),
    ("ROS_DOMAIN_ID", "-1", "ROS_DOMAIN_ID must be 0 to 232, not '-1'"),
    ("ROS_DOMAIN_ID", "\u0661", "ROS_DOMAIN_ID must be 0 to 232, not '\u0661'"),
    ("RMW_IMPLEMENTATION", "rmw_nope", "RMW_IMPLEMENTATION is rmw_nope, which is not installed: unset it, or install"),
    ("RMW_IMPLEMENTATION", "rmw.no/pe", "RMW_IMPLEMENTATION is rmw.no/pe, which is not installed: unset it"),
    (
        "ROS_LOG_DIR",
        "/proc/nope",
        "ROS 2 cannot write its logs to /proc/nope, the folder that ROS_LOG_DIR selects (No such",
    ),
    ("ROS_HOME", "/proc/nope", "ROS 2 cannot write its logs to /proc/nope/log, the folder that ROS_HOME selects"),
    ("HOME", "/proc/nope", "ROS 2 cannot write its logs to /proc/nope/.ros/log, the folder that HOME selects"),
    ("HOME", "", "HOME is not set, but ROS 2 needs a folder for its logs: set ROS_LOG_DIR"),
]
"""Environment variable, value of the variable, and expected message."""


@pytest.fixture
def set_variable(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    pytest.importorskip("rclpy")
    for name in ("ROS_LOG_DIR", "ROS_HOME", "RMW_IMPLEMENTATION"):
        monkeypatch.delenv(name, raising=False)
    return monkeypatch


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
@pytest.mark.parametrize(("name", "value", "words"), SETTINGS)
def test_every_command_reports_an_invalid_variable(
    verb: list[str],
    name: str,
    value: str,
    words: str,
    set_variable: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    set_variable.setenv(name, value)
    assert words in complaint(capsys, set_variable, *verb)


@pytest.mark.parametrize(("name", "value", "words"), SETTINGS)
def test_pick_place_node_reports_an_invalid_variable(
    name: str, value: str, words: str, set_variable: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    set_variable.setenv(name, value)
    assert vision_pick_place_controller.main(["node"]) == 1
    output = capsys.readouterr().err
    assert output.startswith(f"vision_pick_place_controller: {words}") and output.count("\n") == 1


def test_valid_settings_are_accepted(set_variable: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name, value in (("ROS_DOMAIN_ID", ""), ("ROS_DOMAIN_ID", "232"), ("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")):
        set_variable.setenv(name, value)
        require_ros()
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "librmw_other_cpp.so").touch()
    set_variable.setenv("RMW_IMPLEMENTATION", "rmw_other_cpp")
    set_variable.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    set_variable.setenv("HOME", "")
    set_variable.setenv("ROS_LOG_DIR", str(tmp_path / "new" / "log"))
    require_ros()
    assert (tmp_path / "new" / "log").is_dir()


@pytest.mark.slow
@pytest.mark.parametrize("module", ["servoloop", "nodes.vision_pick_place_controller"])
def test_errors_of_rclpy_and_rcl_are_reported_in_one_sentence(module: str, tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    words = ["up", "--hardware", "mock"] if module == "servoloop" else []
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy" / "__init__.py").write_text("raise ImportError('no _rclpy_pybind11 for this Python')\n")
    for name, value, begin in (
        (
            "PYTHONPATH",
            str(tmp_path),
            f"{tmp_path}/rclpy/__init__.py does not work with this Python (no _rclpy_pybind11 for",
        ),
        ("ROS_STATIC_PEERS", "bad peer", "ROS 2 does not start: error creating node: Unable to resolve peer bad peer"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", module, *words],
            env={**os.environ, name: value},
            capture_output=True,
            text=True,
            timeout=60,
        )
        last = done.stderr.strip().splitlines()[-1]
        assert done.returncode == 1 and last.startswith(f"{module.rpartition('.')[2]}: {begin}"), done.stderr
        assert "Traceback" not in done.stderr
