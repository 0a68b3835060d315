"""Tests of messages about torque limits that are incompatible with a servo's protection settings."""

from pathlib import Path

import pytest

from drivers.servos.catalog import MODELS
from hal.robot_file.protection import protection_problems
from hal.robot_file.robot_file import load_robot_file, unprotected
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.shipped_files import CONFIG

FILES = [CONFIG / f"{name}.yaml" for name in ("robot_arm", "robot_arm_dynamixel", "robot_arm_two_buses")]
FILES += sorted(CONFIG.glob("arms/*/robot.yaml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_the_protections_of_every_arm_can_act(path: Path) -> None:
    assert unprotected(load_robot_file(path)) == []


@pytest.mark.parametrize("arm", ["so100", "so101", "so101_12v"])
def test_the_gripper_of_an_so_arm_has_lerobots_protections(arm: str) -> None:
    gripper = load_robot_file(find_arm(arm).robot).joints["gripper"]
    assert gripper.settings == {"max_torque": 500, "protection_current": 250, "overload_torque": 25}
    assert gripper.torque_limit == 0.5


@pytest.mark.parametrize(
    ("model", "limit", "settings", "message"),
    [
        (
            "sts3215",
            0.5,
            {},
            "overload_torque 80 % is not below the torque limit of 50 %, so the overload protection of the servo can "
            "never act. Add settings: {overload_torque: 25}",
        ),
        ("sts3215", 0.8, {}, "overload_torque 80 % is not below the torque limit of 80 %"),
        (
            "sts3215",
            1.0,
            {"max_torque": 700},
            "torque_limit 1 is above 0.7, the limit set by max_torque 700: lower",
        ),
        ("sts3215", 0.7, {"max_torque": 700}, "overload_torque 80 % is not below the torque limit of 70 %"),
        ("sts3215", 1.0, {"overload_torque": 100}, "overload_torque 100 % is not below the torque limit of 100 %"),
        (
            "sts3215",
            0.5,
            {"overload_torque": 25, "protective_torque": 40},
            "protective_torque 40 % is not below overload_torque 25 %, so an overload does not reduce the torque",
        ),
        (
            "sts3215",
            1.0,
            {"unloading_condition": 12},
            "unloading_condition 12 disables the overload protection of the servo",
        ),
        (
            "sts3215",
            1.0,
            {"protection_current": 0},
            "protection_current 0 disables the overcurrent protection of the servo",
        ),
        (
            "sts3215",
            1.0,
            {"overcurrent_time": 0},
            "overcurrent_time 0 disables the overcurrent protection of the servo",
        ),
        ("scs0009", 1.0, {"overload_torque": 100}, "overload_torque 100 % is not below the torque limit of 100 %"),
        (
            "xl430-w250",
            0.6,
            {"pwm_limit": 443},
            "torque_limit 0.6 is above 0.501, the limit set by pwm_limit 443",
        ),
        ("xl430-w250", 0.6, {"shutdown": 32}, "shutdown 32 does not stop the servo at overheating: add 4 to shutdown"),
        ("xl430-w250", 0.6, {"shutdown": 4}, "shutdown 4 does not stop the servo at overload: add 32 to shutdown"),
    ],
)
def test_incompatible_values_are_reported_with_the_remedy(
    model: str, limit: float, settings: dict[str, int], message: str
) -> None:
    assert any(problem.startswith(message) for problem in protection_problems(MODELS[model], limit, settings))


@pytest.mark.parametrize(
    ("model", "limit", "settings"),
    [
        ("sts3215", 1.0, {}),
        ("sts3215", 0.5, {"overload_torque": 49}),
        ("scs0009", 1.0, {}),
        ("xl430-w250", 0.6, {}),
        ("xl330-m288", 0.5, {"pwm_limit": 443}),
        ("ax-12a", 0.5, {}),
    ],
)
def test_compatible_values_are_not_reported(model: str, limit: float, settings: dict[str, int]) -> None:
    assert list(protection_problems(MODELS[model], limit, settings)) == []


def test_loading_a_robot_file_logs_incompatible_values(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = (CONFIG / "robot_arm.yaml").read_text()
    assert ", overload_torque: 25" in text
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace(", overload_torque: 25", ""))
    load_robot_file(path)
    assert f"{path}: hand_right_joint: overload_torque 80 % is not below the torque limit of 50 %" in caplog.text
