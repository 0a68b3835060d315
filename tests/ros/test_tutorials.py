"""Follow the tutorials that create a package in an empty folder, with the commands of the page."""

import subprocess
from pathlib import Path

import pytest

from tests.pages import code, commands
from tests.ros.manager_client import manager_client
from tests.servoloop.test_own_hardware import URDF
from tests.users_folder import UsersFolder

pytestmark = pytest.mark.slow

CONTROLLER, HARDWARE = "write-a-controller.md", "hardware.md"
INSTALL = "pip install --no-build-isolation ."
NO_CONTROLLERS = "controller_manager: {ros__parameters: {update_rate: 20}}\n"


def wait_until_ready(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    printed = []
    for line in process.stdout:
        printed.append(line)
        if line.startswith("ready:"):
            return
    raise AssertionError("".join(printed))


@pytest.mark.runs(*commands(CONTROLLER))
def test_controller_of_the_page_moves_its_joint(ros_domain: int, tmp_path: Path) -> None:
    user = UsersFolder(tmp_path)
    python, toml, yaml = (code(CONTROLLER, language) for language in ("python", "toml", "yaml"))
    user.write(joint_wave_py=python, pyproject_toml=toml, controllers_yaml=yaml)
    install, up = commands(CONTROLLER)
    assert install == INSTALL
    user.run(install)
    with user.start(up) as stack, manager_client() as client:
        wait_until_ready(stack)
        assert client.states() == {"wave": "active"}


@pytest.mark.runs(INSTALL)
def test_hardware_of_the_page_starts(ros_domain: int, tmp_path: Path) -> None:
    user = UsersFolder(tmp_path)
    user.write(belt_py=code(HARDWARE, "python"), pyproject_toml=code(HARDWARE, "toml"))
    user.write(belt_urdf=URDF, controllers_yaml=NO_CONTROLLERS)
    assert commands(HARDWARE) == [INSTALL]
    user.run(INSTALL)
    with user.start("servoloop up --urdf belt.urdf --controllers controllers.yaml") as stack:
        wait_until_ready(stack)
