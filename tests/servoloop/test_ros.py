"""A ROS 2 that is missing, or another one, is told in words."""

import sys
from pathlib import Path

import pytest

from servoloop.ros import PACKAGES
from tests.complaint import complaint

VERBS = [["up", "--hardware", "mock"], ["pick", "B"], ["demo", "--grades", "A"]]


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
@pytest.mark.parametrize("package", ["rclpy", "control_msgs", "sorting_arm_interfaces"])
def test_what_is_missing_is_named(
    verb: list[str], package: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in PACKAGES:
        monkeypatch.setitem(sys.modules, name, sys.modules.get(name, sys))
    monkeypatch.setitem(sys.modules, package, None)
    said = complaint(capsys, monkeypatch, *verb)
    assert f"needs ROS 2 Jazzy, and Python finds no {package}: run 'make setup'" in said


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
def test_another_distribution_is_refused(
    verb: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a sourced one comes: before ours on the path."""
    pytest.importorskip("rclpy")
    info = tmp_path / "rclpy-9.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rclpy\nVersion: 9.1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    said = complaint(capsys, monkeypatch, *verb)
    assert "needs ROS 2 Jazzy (rclpy 7.1.x), and Python finds rclpy 9.1.0: open a shell" in said
