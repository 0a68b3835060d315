"""Controllers of ``servoloop up --no-spawn`` wait for a spawner. This test file uses its own stack."""

from pathlib import Path

import pytest

from tests.ros.manager_client import manager_client
from tests.ros.stack_process import running
from tests.ros.test_manager_spawner import Spawner


@pytest.mark.row("cm-spawner")
def test_controllers_of_the_file_wait_for_the_spawner(ros_domain: int, tmp_path: Path) -> None:
    with running(tmp_path, "--hardware", "mock", "--no-spawn"), manager_client() as client:
        assert client.states() == {}
        assert Spawner(client).spawn("hand_controller") == ""  # The manager knows type and parameters from the file.
        assert client.states() == {"hand_controller": "active"}
        assert client.get("/hand_controller", "joints") == [["hand_right_joint"]]
