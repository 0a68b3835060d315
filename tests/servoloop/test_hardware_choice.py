"""Selection of the hardware by the URDF, the command line and installed plugins."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from controller.manager_errors import ControllersFileError, PluginError
from hal.hal_errors import DescriptionError, HalError, RobotFileError
from hal.hardware import Hardware
from hal.mock_hardware import MockHardware
from hal.servos.servo_hardware import ServoHardware
from servoloop.stack.hardware import HardwareKind, build, choose, compensation
from servoloop.stack.robot_files import Files, initial_states, read_files
from servoloop.stack.shipped_files import CONFIG, CONTROLLERS
from sim_backend.clock import SimulatedClock
from tests.ros.two_components import ARM, HAND, servos, write_robot_file, write_servos, write_urdf

USERS = "<plugin>acme/Arm</plugin>"


def made(files: Files, kind: HardwareKind | None = None) -> tuple[Hardware, ...]:
    below = build(kind, files, {}, SimulatedClock())
    return tuple(component.hardware for component in below.hardware.components)


def test_each_block_has_its_own_plugin_robot_file_and_rate(tmp_path: Path) -> None:
    files = read_files(write_urdf(tmp_path, arm=servos(write_robot_file(tmp_path, "arm", *ARM))))
    below = build(None, files, {}, SimulatedClock())
    arm, hand = below.hardware.components
    assert isinstance(arm.hardware, ServoHardware) and isinstance(hand.hardware, MockHardware)
    assert (arm.hardware.joints, hand.hardware.joints) == (ARM, (HAND,))
    assert (arm.cycles_per_update, hand.cycles_per_update) == (1, 2)
    assert list(below.set_compensation) == ["arm"]
    assert not below.virtual  # there is no feed of an emulator at this port
    assert files.robot_paths == {"arm": tmp_path / "arm.yaml"}


def test_two_blocks_of_servos_name_their_buses(tmp_path: Path) -> None:
    files = read_files(write_servos(tmp_path))
    assert list(files.robot.file.lines()) == ["arm", "hand"]
    assert [type(one) for one in made(files)] == [ServoHardware, ServoHardware]


def test_only_servos_lag_and_unknown_lags_are_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = tmp_path / "robot.yaml"
    robot.write_text((CONFIG / "robot_arm_dynamixel.yaml").read_text().replace("position_p: 2400", "position_p: 0", 1))
    files = read_files(robot=robot)
    with caplog.at_level("INFO"):
        assert set(build(None, files, {}, SimulatedClock()).compliances) == {*(f"joint{i}" for i in range(2, 7)), HAND}
    assert "joint1: the servo stiffness is unknown" in caplog.text
    assert build(HardwareKind.MOCK, files, {}, SimulatedClock()).compliances == {}


def test_the_robot_file_can_disable_gravity_compensation(tmp_path: Path) -> None:
    robot = tmp_path / "robot.yaml"
    robot.write_text((CONFIG / "robot_arm.yaml").read_text() + "gravity_compensation: false\n")
    files = read_files(robot=robot)
    assert compensation(files.robot.joints, files.description) is None
    files = read_files()
    assert compensation(files.robot.joints, files.description) is not None


def test_the_command_line_overrides_all_components(tmp_path: Path) -> None:
    files = read_files(write_urdf(tmp_path, arm=servos(write_robot_file(tmp_path, "arm", *ARM))))
    assert [type(one) for one in made(files, HardwareKind.MOCK)] == [MockHardware, MockHardware]
    with pytest.raises(DescriptionError, match="hand has servos but no robot file: specify the file"):
        made(files, HardwareKind.SERVOS)
    with pytest.raises(DescriptionError, match="only one component can run in MuJoCo"):
        made(files, HardwareKind.MUJOCO)


@pytest.mark.parametrize("command", ["velocity", "effort"])
def test_servos_accept_positions_and_a_mock_accepts_the_declared_interfaces(tmp_path: Path, command: str) -> None:
    path = write_urdf(tmp_path, arm=servos(write_robot_file(tmp_path, "arm", *ARM)))
    text = path.read_text()
    first = '<joint name="joint1">\n'
    assert first in text
    path.write_text(text.replace(first, f'{first}<command_interface name="{command}"/>'))
    files = read_files(path)
    assert made(files, HardwareKind.MOCK)[0].command_interfaces[0] == f"joint1/{command}"
    assert files.limits["joint1"].acceleration == files.robot.limits()["joint1"].acceleration
    for kind in (None, HardwareKind.SERVOS):
        with pytest.raises(DescriptionError, match=f"arm: the URDF has the command interface joint1/{command}, but"):
            made(files, kind)


def test_a_mock_needs_no_robot_file(tmp_path: Path) -> None:
    files = read_files(write_urdf(tmp_path))
    assert files.robot.joints == ()
    assert (files.limits["joint1"].velocity, files.limits[HAND].upper) == (
        files.description.joints["joint1"].velocity,
        0.05,
    )
    assert build(None, files, {}, SimulatedClock()).virtual


def test_one_robot_option_is_not_enough_for_two(tmp_path: Path) -> None:
    arm = servos(write_robot_file(tmp_path, "arm", *ARM))
    urdf = write_urdf(tmp_path, arm, arm)
    with pytest.raises(DescriptionError, match=r"several components with servos \(arm, hand\): instead of --robot"):
        read_files(urdf, robot=CONFIG / "robot_arm.yaml")


def test_a_robot_file_is_found_next_to_the_urdf_and_errors_name_it(tmp_path: Path) -> None:
    write_robot_file(tmp_path, "arm", *ARM[:5])
    with pytest.raises(RobotFileError) as caught:
        read_files(write_urdf(tmp_path, arm=servos(Path("arm.yaml"))))
    assert str(caught.value).startswith(
        f"{tmp_path}/arm.yaml:4: the URDF commands joint6, but the robot file has no servo"
    )


def test_an_unknown_plugin_is_refused(tmp_path: Path) -> None:
    files = read_files(write_urdf(tmp_path, hand="<plugin>nobody/Knows</plugin>"))
    with pytest.raises(
        DescriptionError, match="hand: unknown <plugin> nobody/Knows: choose one of servoloop/ServoHardware"
    ):
        made(files)


ACME = """
from hal.hal_errors import HalError
from hal.mock_hardware import MockHardware

def make(component, clock):
    if component.parameters.get("port") == "none":
        raise HalError("port: none: name a port")
    return MockHardware(component.name, component.joints, clock)

def broken(component, clock):
    return component.no_such_thing

def other(component, clock):
    return MockHardware(component.name, ["thumb"], clock)
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install the package of a user as pip does."""
    folder = tmp_path / "site"
    info = folder / "acme-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "acme_hardware.py").write_text(ACME)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    lines = "acme/Arm = acme_hardware:make\nacme/Broken = acme_hardware:broken\nacme/Gone = acme_gone:make\n"
    lines += "acme/Other = acme_hardware:other\n"
    (info / "entry_points.txt").write_text(f"[servoloop.hardware]\n{lines}")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "acme_hardware", raising=False)


@pytest.mark.usefixtures("installed")
def test_a_users_own_hardware(tmp_path: Path) -> None:
    files = read_files(write_urdf(tmp_path, hand=USERS))
    _, hand = made(files)
    assert (hand.name, hand.joints) == ("hand", (HAND,))
    assert not build(None, files, {}, SimulatedClock()).virtual  # it may be real


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("hand", "error", "says"),
    [
        ('<plugin>acme/Arm</plugin><param name="port">none</param>', HalError, "port: none: name a port"),
        ("<plugin>acme/Broken</plugin>", PluginError, r"the hardware acme/Broken \(acme_hardware:broken\) cannot be"),
        ("<plugin>acme/Gone</plugin>", PluginError, "No module named 'acme_gone'"),
        (
            '<plugin>acme/Arm</plugin></hardware><gpio name="tool"><command_interface name="pump"/></gpio><hardware>',
            PluginError,
            "the hardware acme/Arm has no output tool/pump: remove this <command_interface> from its",
        ),
        (
            "<plugin>acme/Other</plugin>",
            PluginError,
            rf"acme/Other has the joints \('thumb',\), but its <ros2_control> block 'hand' has \('{HAND}',\): copy",
        ),
    ],
)
def test_user_hardware_that_cannot_be_created_is_refused(
    tmp_path: Path, hand: str, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        made(read_files(write_urdf(tmp_path, hand=hand)))


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("plugin", ["servos", "servoloop/MujocoHardware", "mock_components/GenericSystem", "acme/Arm"])
@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('lower="0" upper="0.05"', 'lower="0" upper="-0.04"', "lower limit 0.0 is above upper limit -0.04 ({}): swap"),
        ('velocity="0.09"', 'velocity="0"', "velocity limit must be above 0, not 0.0 ({}): write"),
    ],
)
def test_the_limits_are_checked_for_every_kind_of_hardware(
    tmp_path: Path, plugin: str, old: str, new: str, says: str
) -> None:
    hand = servos(write_robot_file(tmp_path, "hand", HAND)) if plugin == "servos" else f"<plugin>{plugin}</plugin>"
    urdf = write_urdf(tmp_path, hand=hand)
    text = urdf.read_text()
    at = text.index(old, text.index(f'<joint name="{HAND}"'))
    urdf.write_text(text[:at] + text[at:].replace(old, new, 1))
    place = f"{urdf}, line {text[:at].count(chr(10)) + 1}"
    with pytest.raises(DescriptionError) as caught:
        read_files(urdf)
    assert f"{HAND}: {says.format(place)}" in str(caught.value)


@pytest.mark.parametrize(
    ("said", "says"),
    [
        ("{inactive: [foot]}", "lists foot, but the URDF has arm, hand"),
        ("{asleep: [arm]}", "must contain the lists unconfigured and inactive, not asleep"),
        ("{inactive: arm}", "must contain the lists unconfigured and inactive, not inactive"),
    ],
)
def test_invalid_initial_states_are_refused(tmp_path: Path, said: str, says: str) -> None:
    path = tmp_path / "controllers.yaml"
    rate = "    update_rate: 20\n"
    path.write_text(CONTROLLERS.read_text().replace(rate, f"{rate}    hardware_components_initial_state: {said}\n"))
    files = read_files(write_urdf(tmp_path), path)
    with pytest.raises(ControllersFileError, match=says):
        initial_states(files)


def test_an_outdated_plugin_name_selects_its_successor() -> None:
    files = read_files()
    (component,) = files.description.components
    outdated = replace(component, plugin="fake_components/GenericSystem")
    assert choose(None, outdated) is HardwareKind.MOCK
