"""The parameter file of docs/several-arms.md."""

from pathlib import Path

import pytest

from servoloop.stack.arm_folders import find_arm, read_arm_files
from tests.pages import code


@pytest.mark.runs("several-arms.md yaml 1")
@pytest.mark.parametrize(("namespace", "parameters"), [("/left", {"frame_prefix": "left_arm/"}), ("/right", {})])
def test_each_stack_reads_its_sections(tmp_path: Path, namespace: str, parameters: dict[str, str]) -> None:
    path = tmp_path / "controllers.yaml"
    path.write_text(code("several-arms.md", "yaml"))
    files = read_arm_files(find_arm("so101"), controllers=path, namespace=namespace)
    assert [spec.name for spec in files.controllers.controllers] == ["joint_state_broadcaster", "arm_controller"]
    assert files.controllers.controllers[1].node_arguments == ("--ros-args", "-r", "~/controller_state:=arm_state")
    assert files.controllers.parameters("robot_state_publisher") == parameters
    assert files.options[-2:] == ("--namespace", namespace)
