"""Arguments of child processes: an emulator or a stack reads exactly the files that its parent has read."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from servoloop.cli import app
from servoloop.stack.arm_folders import arms, find_arm, read_arm_files
from servoloop.stack.emulator_process import emulate_arguments
from servoloop.stack.robot_files import Files, ServoFiles
from servoloop.stack.shipped_files import ARMS, CONFIG, CONTROLLERS
from tests.commissioning.patient import NOBODYS_MACHINE
from tests.complaint import complaint
from tests.ros.two_components import ARM, HAND, servos, write_robot_file, write_urdf

ReadFiles = Callable[[Path], Files]


def named(name: str) -> ReadFiles:
    return lambda folder: read_arm_files(find_arm(name))


def as_a_copy(name: str) -> ReadFiles:
    """Return a user's folder that has the name of an included arm but different zeros, given by its relative path."""

    def files(folder: Path) -> Files:
        for one in ("so101", name):
            shutil.copytree(ARMS / one, folder / one, dirs_exist_ok=True)
        robot = folder / name / "robot.yaml"
        robot.write_text(robot.read_text().replace("zero_counts: 2047", "zero_counts: 1500", 1))
        return read_arm_files(find_arm(f"./{name}"))

    return files


def two_buses(folder: Path) -> Files:
    return read_arm_files(find_arm(), robot=CONFIG / "robot_arm_two_buses.yaml")


def two_components(folder: Path) -> Files:
    robots = [servos(write_robot_file(folder, name, *of)) for name, of in (("arm", ARM), ("hand", (HAND,)))]
    return read_arm_files(find_arm(), write_urdf(folder, *robots))


def single_files(folder: Path) -> Files:
    """Return single files, given by relative paths, whose joints are not those of the default arm."""
    so101 = find_arm("so101")
    for path in (so101.urdf, so101.controllers, find_arm("so101_12v").robot):
        shutil.copy(path, folder / path.name)
    return read_arm_files(find_arm(), Path("arm.urdf"), Path("controllers.yaml"), Path("robot.yaml"))


CASES: dict[str, ReadFiles] = {
    **{arm.name: named(arm.name) for arm in arms()},
    **{f"./{name}": as_a_copy(name) for name in ("so101", "so101_12v", "so101_leader")},
    "two buses": two_buses,
    "two components": two_components,
    "single files": single_files,
}


@pytest.fixture(params=CASES)
def files(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Files:
    monkeypatch.chdir(tmp_path)
    return CASES[request.param](tmp_path)


def given(monkeypatch: pytest.MonkeyPatch, function: str, *arguments: str) -> list[Any]:
    """Return the arguments with which a command calls this function."""
    calls: list[Any] = []
    monkeypatch.setattr(function, lambda *given, **more: calls.extend(given))
    result = CliRunner().invoke(app, arguments)
    assert calls, result.output or result.exception
    return calls


def read_again(files: ServoFiles) -> dict[str, object]:
    names = ("arm", "arm_folder", "folder", "scene", "limits", "robot", "component")
    paths = {name: path.resolve() for name, path in files.robot_paths.items()}
    described = {"urdf": files.urdf_path.resolve(), "xml": files.description.xml, "robots": paths}
    return {**{name: getattr(files, name) for name in names}, **described}


def test_an_emulator_serves_the_arm_of_its_parent(
    files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    served, *_ = given(monkeypatch, "servoloop.stack.emulator.emulate", *emulate_arguments(tmp_path / "bus", files))
    assert read_again(served) == read_again(files)


def test_a_stack_runs_the_arm_of_its_parent(files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, run, *_ = given(monkeypatch, "servoloop.up.up", "up", *files.options)
    assert read_again(run) == read_again(files)
    assert (run.controllers.path, run.controllers.controllers) == (
        files.controllers.path.absolute(),
        files.controllers.controllers,
    )


@pytest.mark.parametrize("verb", ["emulate ./bus", "up --hardware mujoco", "up --rtf max"])
def test_an_arm_that_is_not_in_the_scene_is_refused(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    so101 = find_arm("so101")
    files = ["--urdf", str(so101.urdf), "--robot", str(so101.robot)]
    if verb.startswith("up"):
        files += ["--controllers", str(so101.controllers)]
    said = complaint(capsys, monkeypatch, *verb.split(), *files).splitlines()
    assert said == [
        f"servoloop: {find_arm().scene} has no actuator for shoulder_pan, shoulder_lift, elbow_flex, wrist_flex, "
        "wrist_roll, gripper: choose the arm that has these joints with --arm"
    ]


@pytest.mark.parametrize("verb", ["emulate ./bus", "up --hardware mujoco", "simulate --seconds 1"])
def test_a_missing_scene_is_reported(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ARMS / "so101", "mine")
    Path("mine/scene.xml").unlink()
    said = complaint(capsys, monkeypatch, *verb.split(), "--arm", "./mine")
    assert f"{tmp_path / 'mine/scene.xml'} is missing" in said and "Traceback" not in said


@pytest.mark.parametrize("verb", ["emulate ./bus", "doctor --port ./none", "tune shoulder_pan --port ./none --yes"])
def test_servos_of_another_urdf_need_no_controllers(verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The controllers of the default arm are for different joints."""
    monkeypatch.chdir(tmp_path)
    read: list[ServoFiles] = []
    monkeypatch.setattr("servoloop.stack.emulator.emulate", lambda files, *more, **named: read.append(files))
    so101 = find_arm("so101")
    urdf, robot = str(so101.urdf), str(so101.robot)
    result = CliRunner().invoke(app, [*verb.split(), "--urdf", urdf, "--robot", robot])
    said = f"{result.output}{result.exception}"
    assert "arm_controller" not in said and (read or "./none" in said), said


def test_controllers_that_do_not_fit_another_urdf_are_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    so101 = find_arm("so101")
    urdf, robot = str(so101.urdf), str(so101.robot)
    assert str(CONTROLLERS) in complaint(capsys, monkeypatch, "up", "--urdf", urdf, "--robot", robot)


@pytest.mark.parametrize(
    "verb",
    [
        "calibrate --arm so101 --port virtual",
        "teleop virtual ./leader --leader-arm so101 --hands-free",
        "replay way --arm so101 --port virtual --hands-free",
    ],
)
def test_virtual_is_refused_for_an_arm_that_is_moved_by_hand(
    verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = complaint(capsys, monkeypatch, *verb.split())
    assert (
        "'virtual' is not a serial port" in said
        and "`servoloop emulate LINK --arm so101` and pass LINK as the port" in said
    )


@pytest.mark.parametrize("verb", ["doctor", "tune shoulder_pan --yes", "bench arm --yes"])
def test_virtual_servos_are_suggested_if_no_adapter_is_plugged_in(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("commissioning.ports.adapters.Machine", lambda: NOBODYS_MACHINE)
    said = complaint(capsys, monkeypatch, *verb.split(), "--arm", "so101")
    assert "no USB adapter was found" in said and "; for virtual servos, use --port virtual\n" in said
