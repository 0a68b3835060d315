"""Reports of the stack for each kind of fault, as in the table of docs/faults.md, with both makes of servos.

The last column of a row contains the messages of the stack. Each message must be reported when the example of the row
is injected into an arm with STS servos. ``DYNAMIXEL`` contains the messages that differ for Dynamixels.
"""

import re
from pathlib import Path
from typing import NamedTuple

import pytest

from servoloop.commands.emulate import does
from sim_backend.faults.events import KINDS
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.player import require_possible
from sim_backend.faults.text import parse, words
from tests.faults.rig import FaultRig, told

DOCS = Path(__file__).resolve().parents[2] / "docs" / "faults.md"
COLUMNS = ("kind", "parameters", "example", "what happens", "what the stack says")


class Row(NamedTuple):
    kind: str
    parameters: list[str]
    example: str
    happens: str
    said: list[str]


def rows() -> dict[str, Row]:
    """Return the rows of the table by kind."""
    found: dict[str, Row] = {}
    for line in DOCS.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if line.startswith("| `") and len(cells) == len(COLUMNS):
            kind, parameters, example, happens, said = cells
            quoted = re.compile(r"`([^`]+)`")
            found[kind.strip("`")] = Row(
                kind.strip("`"), quoted.findall(parameters), example.strip("`"), happens, quoted.findall(said)
            )
    return found


ROWS = rows()
ARMS = {"hardware_error": "robot_arm_dynamixel"}
"""Arms for the kinds of faults that STS servos cannot have."""


def test_the_table_has_every_kind_and_its_parameters() -> None:
    assert list(ROWS) == list(KINDS)
    for name, kind in KINDS.items():
        assert ROWS[name].parameters == [word for word in words(kind) if word not in ("at", "since")], name
        assert ROWS[name].happens == does(name)
        assert parse(ROWS[name].example).kind == name


@pytest.mark.parametrize("kind", KINDS)
def test_the_stack_reports_each_fault_as_the_table_says(kind: str) -> None:
    row = ROWS[kind]
    rig = told(ARMS.get(kind, "robot_arm"), parse(row.example), row.said)
    for quotation in row.said:
        assert rig.says(quotation), f"{quotation!r} is not among {rig.said}"
    assert row.said, "the stack reports nothing"


DYNAMIXEL = {
    "silent id=3 at=0.2s for=1s": ["joint3: servo 3 does not respond", "servo 3 responds again"],
    "brown_out id=3 at=0.2s": [
        "servo 3 has lost the mapping of its indirect registers",
        "servo 3 returned with its torque disabled",
    ],
    "cable_cut after=5": ["joint6: servo 6 does not respond", "servo 7 does not respond"],
    "weak_supply voltage=6": ["joint1: alarm: voltage", "goal: SUCCEEDED"],
    "weak_supply voltage=2 for=0.5s": ["no servo responds on", "joint1: servo 1 returned with its torque disabled"],
    "flipped_replies id=3": ["servo 3 replied with a wrong checksum"],
    "echo": ["goal: SUCCEEDED"],
    "overload id=3 torque=6": ["joint3: alarm: overload", "servo 3 has lost its torque"],
    "jammed id=3": ["joint3: alarm: overload", "joint3 is off by"],
    "hardware_error id=3 error=motor_encoder": ["joint3: alarm: motor encoder", "goal: SUCCEEDED"],
    "hot id=3 temperature=90": ["servo 3 released its torque (temperature alarm)"],
    "stuck_encoder id=3": ["joint3 is off by"],
    "wrong_mode id=3 mode=16": ["servo 3 has lost its torque"],
    "wrong_rate id=3 baud=57600": ["servo 3 does not respond"],
    "eeprom_gone id=3": ["servo 3 does not respond"],
    "foreign_packets id=3 does=lets_go": ["servo 3 has lost its torque"],
}
"""Reports of an arm with Dynamixels."""


@pytest.mark.parametrize("example", DYNAMIXEL)
def test_dynamixels_can_have_the_same_faults(example: str) -> None:
    rig = told("robot_arm_dynamixel", parse(example), DYNAMIXEL[example])
    for quotation in DYNAMIXEL[example]:
        assert rig.says(quotation), f"{quotation!r} is not among {rig.said}"


@pytest.mark.parametrize("arm", ["robot_arm", "robot_arm_dynamixel"])
@pytest.mark.parametrize("example", ["silent id=3", "brown_out id=3", "lost_replies id=3", "wrong_id id=3 to=99"])
def test_a_fault_of_one_servo_is_reported_within_two_cycles_and_hides_no_other_servo(arm: str, example: str) -> None:
    rig = FaultRig(arm)
    rig.up()
    rig.run(0.2)
    rig.play(parse(example))
    rig.endure(2.5 * rig.loop.period_s)
    assert set(rig.kinds) == {"joint3"}
    rig.endure(1.5)
    assert set(rig.kinds) == {"joint3"}


def test_faults_that_a_servo_cannot_have_are_refused_with_a_reason() -> None:
    """If a list contains several impossible faults, all of them are refused at once."""
    rig = FaultRig("robot_arm_dynamixel")
    wrong = [
        "dead_encoder id=3",
        "overcurrent id=2",
        "wrong_rate id=3 baud=12345",
        "wrong_mode id=1 mode=7",
        "silent id=9",
    ]
    with pytest.raises(FaultError) as refused:
        require_possible(map(parse, wrong), rig.player.targets.inventory)
    said = str(refused.value).splitlines()
    assert len(said) == len(wrong)
    for line, why in zip(
        said,
        ["does not report the state of its encoder", "no overcurrent protection", "not 12345", "not 7", "no servo 9"],
        strict=True,
    ):
        assert why in line


def test_a_reply_to_another_program_does_not_count_as_loss_of_torque() -> None:
    """An STS reply does not contain its instruction, so a reply of the expected size to another program is accepted."""
    rig = told("robot_arm", parse("foreign_packets id=3 every=20ms"))
    assert not rig.kinds, rig.said
