"""Each script in examples/ runs on a virtual arm."""

import builtins
import runpy
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from commissioning.calibrate.run import HANDS_OFF
from drivers.port import Port
from servoloop.stack.shipped_files import ARMS
from tests.api.loaded_arm import LoadedArm
from tests.commissioning.arm import Person, UnalignedArm
from tests.pages import ROOT

EXAMPLES = ROOT / "examples"
PAN = "shoulder_pan"


@pytest.fixture
def arm() -> Iterator[LoadedArm]:
    with LoadedArm() as arm:
        yield arm


def main_of(name: str) -> Any:
    return runpy.run_path(str(EXAMPLES / name))["main"]


def test_every_example_has_a_test() -> None:
    text = Path(__file__).read_text()
    assert len(list(EXAMPLES.glob("*.py"))) == 8
    for path in EXAMPLES.glob("*.py"):
        assert f'"{path.name}"' in text and len(path.read_text().splitlines()) <= 60, path


def test_three_poses(arm: LoadedArm, capsys: pytest.CaptureFixture[str]) -> None:
    main_of("three_poses.py")(arm)
    assert [line.partition(":")[0] for line in capsys.readouterr().out.splitlines()] == ["ready", "left", "stretched"]


def test_stream_sine(arm: LoadedArm, capsys: pytest.CaptureFixture[str]) -> None:
    pan: list[float] = []
    arm.on_state(lambda state: pan.append(state.position[PAN]))
    main_of("stream_sine.py")(arm)
    assert "streamed for 4.0 s" in capsys.readouterr().out
    assert max(pan) == pytest.approx(0.4, abs=0.1) and min(pan) == pytest.approx(-0.4, abs=0.1)


@pytest.mark.parametrize("blocked", [False, True])
def test_grip_by_load(arm: LoadedArm, blocked: bool) -> None:
    if blocked:  # an object between the jaws pushes them apart
        arm.on_state(lambda state: arm.push("gripper", 0.5 if state.position["gripper"] < 0.4 else 0.0))
    assert main_of("grip_by_load.py")(arm) is blocked
    assert (arm.state.position["gripper"] > 0.2) is blocked


def test_temperatures_to_csv(arm: LoadedArm, tmp_path: Path) -> None:
    main_of("temperatures_to_csv.py")(arm, tmp_path / "t.csv")
    head, *rows = (tmp_path / "t.csv").read_text().splitlines()
    assert head.split(",") == ["time_s", *arm.joints] and len(rows) == 10
    assert all(20 < int(value) < 60 for value in rows[0].split(",")[1:])


def test_teach_and_replay(arm: LoadedArm, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def hand(question: str) -> str:
        for load in (1.0, -1.0, 0.0) if question.startswith("Move the arm") else ():
            arm.push(PAN, load)
            arm.sleep(0.4)
        return ""

    monkeypatch.setattr(builtins, "input", hand)
    main_of("teach_and_replay.py")(arm)
    assert "recorded" in capsys.readouterr().out


@pytest.mark.slow
def test_calibrate_by_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ARMS / "so101", tmp_path / "so101")
    unaligned = UnalignedArm(4, 1.0, "so101")
    hand = Person(unaligned, unaligned.plan.joints)
    monkeypatch.setattr("servoloop.stack.hardware.servo_bus", lambda *_: unaligned.open_bus(unaligned.joints))
    module = runpy.run_path(str(EXAMPLES / "calibrate_by_hand.py"))

    class Scripted(module["Person"]):  # type: ignore[valid-type, misc]
        """The person in the example, whose hands are simulated."""

        def until_done(self, task: Any, update: Any) -> None:
            hand.until_done(task, update)

        def say(self, text: str) -> None:
            hand.say(text)
            if text == HANDS_OFF:
                unaligned.hand.release()

    def open_port(*_: object) -> Port | None:
        return None

    monkeypatch.setattr(builtins, "input", lambda question="": "y")
    unaligned.hand.hold()
    module["main"](str(tmp_path / "so101"), "", Scripted(), open_port, unaligned.clock)
    assert (tmp_path / "so101" / "robot.calibration.yaml").exists()


def test_own_controller(arm: LoadedArm) -> None:
    roll: list[float] = []
    arm.on_state(lambda state: roll.append(state.position["wrist_roll"]))
    main_of("own_controller.py")(arm)
    assert max(roll[-120:]) == pytest.approx(0.2, abs=0.05) and min(roll[-100:]) == pytest.approx(-0.2, abs=0.05)
    assert roll[-1] == pytest.approx(0.0, abs=0.05)


@pytest.mark.slow
def test_test_own_robot() -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(EXAMPLES / "test_own_robot.py")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=110, check=False)
    assert done.returncode == 0 and "4 passed" in done.stdout, done.stdout


@pytest.mark.slow
@pytest.mark.runs("python examples/three_poses.py")
def test_an_example_runs_as_a_program() -> None:
    command = [sys.executable, "examples/three_poses.py"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=110, check=False)
    assert done.returncode == 0 and "stretched: reached" in done.stdout, done.stdout + done.stderr
