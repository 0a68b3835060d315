"""The commands and figures of docs/tune.md on an arm in simulated time."""

import errno
import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from commissioning.tune import predict as law
from commissioning.tune import propose, trial
from commissioning.tune import trial as plan
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.servos import sts
from hal.joint import Joint
from hal.robot_file.robot_file import RobotFile
from servoloop.stack.hardware import servo_bus
from tests.commissioning.patient import Patient
from tests.commissioning.served import run
from tests.pages import DOCS, blocks, code

PAGE = "tune.md"
TEXT = " ".join((DOCS / PAGE).read_text().split())
REAL, VIRTUAL, _ = (block.commands for block in blocks(PAGE) if block.language == "sh")
LIFT = 2
"""ID of the servo of shoulder_lift."""


@pytest.fixture
def arm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Patient:
    """An SO-101 in simulated time on every port, in a new working folder."""
    patient = Patient("so101")

    def opened(file: RobotFile, devices: Mapping[str, str], clock: Clock) -> dict[str, Bus]:
        return {name: servo_bus(file, patient.open(device, 1_000_000), clock, name) for name, device in devices.items()}

    monkeypatch.setattr("servoloop.stack.hardware.open_buses", opened)
    monkeypatch.setattr("drivers.clock.MonotonicClock", lambda: patient.clock)
    monkeypatch.chdir(tmp_path)
    return patient


def typed(monkeypatch: pytest.MonkeyPatch, command: str, answer: str = "") -> int:
    return run(monkeypatch, *shlex.split(command)[1:], answer=answer)


def torque(arm: Patient) -> list[int]:
    return [servo.memory.get(sts.torque_enable) for servo in arm.line.servos]


@pytest.mark.runs(REAL[0])
def test_the_first_command_asks_measures_and_writes_nothing(
    arm: Patient, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = [servo.memory.read(4, 36) for servo in arm.line.servos]
    assert typed(monkeypatch, REAL[0], answer="n\n") == 1
    assert not any(torque(arm)) and not list(Path("out/tune").iterdir())
    assert typed(monkeypatch, REAL[0], answer="y\n") == 0
    said = capsys.readouterr()
    assert "shoulder_lift (servo 2) will move with torque enabled" in said.err
    assert "At the end the arm moves to its park pose and its torque is disabled." in said.err
    assert "the arm is in its park pose, and its torque is off" in said.err
    assert "overshoot" in said.out and "P 32" in said.out and "Plot: out/tune/shoulder_lift.svg" in said.out
    assert [servo.memory.read(4, 36) for servo in arm.line.servos] == before
    assert not any(torque(arm))
    assert ElementTree.parse("out/tune/shoulder_lift.svg").getroot().tag.endswith("svg")


@pytest.mark.slow
@pytest.mark.runs(REAL[1])
def test_written_gains_are_shown_with_both_measurements(
    arm: Patient, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert typed(monkeypatch, REAL[1], answer="y\n") == 0
    said = capsys.readouterr()
    assert (
        "P=24 D=32 will be written to servo 2 after the first measurement. Before the write, the torque of the arm is "
        "disabled" in said.err
    )
    words = " ".join(said.out.split())
    assert "servo 2: P (position_p) changed from 32 to 24" in words
    assert "under joints, shoulder_lift: settings: {position_p: 24}" in words
    assert "predicted for" in words
    assert arm.line.servo(LIFT).memory.get(sts.lock) == 1
    picture = Path("out/tune/shoulder_lift.svg").read_text()
    assert "P 32, D 32, I 0" in picture and "P 24, D 32, I 0" in picture


@pytest.mark.slow
@pytest.mark.runs(REAL[2], VIRTUAL[2])
@pytest.mark.parametrize("command", [f"{REAL[2]} --json", VIRTUAL[2]], ids=["real", "virtual"])
def test_json_output_and_applying_a_proposal(
    command: str, arm: Patient, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Run the last command of the page. A wide dead zone ensures that there is a proposal."""
    arm.put(LIFT, sts.cw_dead_zone, 6)
    assert typed(monkeypatch, command, answer="y\n") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["proposal"]["values"]["cw_dead_zone"] == 1
    assert {"gain": "cw_dead_zone", "register": "cw_dead_zone", "old": 6, "new": 1} in told["written"]
    assert told["after"]["gains"]["cw_dead_zone"] == 1 and told["unit"] == "rad"
    assert told["after"]["figures"]["delay_s"] > 0.0
    assert told["robot_file"]["settings"]["cw_dead_zone"] == 1
    assert arm.line.servo(LIFT).memory.get(sts.cw_dead_zone) == 1


@pytest.mark.slow
@pytest.mark.parametrize("json_", [True, False])
def test_a_failed_plot_does_not_hide_the_figures(
    json_: bool, arm: Patient, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def no_room(fd: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", no_room)
    command = REAL[1] + (" --json" if json_ else "")
    assert typed(monkeypatch, command, answer="y\n") == 1
    said = capsys.readouterr()
    assert "cannot write out/tune/shoulder_lift.svg: No space left on device" in said.err
    if json_:
        told = json.loads(said.out)
        assert told["picture"] is None and told["written"][0]["register"] == "position_p"
    else:
        assert "servo 2: P (position_p) changed from 32 to 24" in " ".join(said.out.split())


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("tune wrist --arm so101 --port ./bus --yes", "no joint wrist: choose one of shoulder_pan"),
        (
            "tune shoulder_lift P=24 --arm so101 --port ./bus --yes",
            "gains need the option --write, as in --write P=24",
        ),
        ("tune shoulder_lift --arm so101 --port ./bus --apply --write P=24", "use only one of them"),
        ("tune shoulder_lift --arm so101 --port ./bus --write P=999", "P must be 1 to 254, not 999"),
        ("tune shoulder_lift --arm so101 --port ./bus --at 3 --yes", "cannot move to 3.000"),
        ("tune shoulder_lift --arm so101 --port ./bus --out . --yes", ". is a folder: choose the name of a file"),
    ],
)
def test_mistakes_are_reported_before_any_motion(
    words: str, says: str, arm: Patient, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, *shlex.split(words)) == 1
    assert says in capsys.readouterr().err
    assert not any(torque(arm))


def test_the_figures_of_the_page_are_those_of_the_code() -> None:
    assert (
        f"moves by {plan.LIFT_RAD} rad toward the middle" in TEXT and f"slowly by another {plan.STEP_RAD} rad" in TEXT
    )
    assert f"a rest of {trial.REST_S} s after each step" in TEXT and f"less than {plan.LEAST_RAD} rad" in TEXT
    assert f"above {propose.ALLOWED_REST_COUNTS:.0f} counts" in TEXT
    assert f"above {propose.ALLOWED_OVERSHOOT:.0%} of the step".replace("%", " %") in TEXT
    assert propose.MOST_D_TO_P == 2.0 and "at most twice P" in TEXT
    assert propose.CALMER == 0.75 and f"not below {propose.LEAST_P}" in TEXT
    assert f"above the factory value of {propose.FACTORY_P}" in TEXT
    assert f"stays {trial.BEHIND_RAD} rad behind" in TEXT
    assert law.CLEAR_COUNTS == 2.0


@pytest.mark.slow
@pytest.mark.runs(f"{PAGE} python 1")
def test_the_program_of_the_page(arm: Patient, capsys: pytest.CaptureFixture[str]) -> None:
    file, joints = arm.robot.file, arm.robot.joints

    def open_buses(among: Sequence[Joint]) -> dict[str, Bus]:
        return {"": servo_bus(file, arm.open("", 1_000_000), arm.clock)}

    assert file.park is not None
    names = {"joints": joints, "open_buses": open_buses, "clock": arm.clock, "park": file.park.pose}
    exec(code(PAGE, "python"), names)
    assert len(capsys.readouterr().out.splitlines()) >= 1 and names["report"].after  # type: ignore[attr-defined]
    assert arm.line.servo(LIFT).memory.get(sts.position_p) == 24


@pytest.mark.runs(f"{PAGE} yaml 1")
def test_the_line_of_the_page_keeps_the_gains() -> None:
    said = yaml.safe_load(code(PAGE, "yaml"))
    joint = RobotFile.model_validate({"joints": said}).joints["shoulder_lift"]
    assert joint.settings == {"position_p": 24, "position_d": 32}
