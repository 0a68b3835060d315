"""A ``SimpleTransmission`` of the URDF is applied between servo and joint, and other transmissions are refused."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from hal.hal_errors import DescriptionError
from hal.joint import Joint
from hal.robot_description.description import parse_urdf
from servoloop.campaign.invariants.reference import read_reference
from servoloop.stack.arm_folders import find_arm, read_arm_servos
from servoloop.stack.robot_files import ServoFiles

TURN = 4096
GEAR = """<transmission name="gear"><plugin>transmission_interface/SimpleTransmission</plugin>
<actuator name="motor" role="actuator1"/><joint name="{joint}" role="joint1">{inside}</joint></transmission>
</ros2_control>"""


def geared(folder: Path, inside: str, joint: str = "gripper", text: str = GEAR) -> ServoFiles:
    """Read an SO-101 that has a gear in its URDF and no zero for the gripper in its robot file."""
    own = find_arm("so101").folder
    urdf, robot = folder / "arm.urdf", folder / "robot.yaml"
    urdf.write_text((own / "arm.urdf").read_text().replace("</ros2_control>", text.format(inside=inside, joint=joint)))
    robot.write_text((own / "robot.yaml").read_text().replace("zero_counts: 2047\n    torque", "torque"))
    return read_arm_servos(find_arm("so101"), urdf, robot)


def gripper(files: ServoFiles) -> Joint:
    return next(joint for joint in files.robot.joints if joint.name == "gripper")


@pytest.mark.parametrize(
    ("inside", "at_zero", "at_one"),
    [
        ("", 2048, 2048 + TURN / math.tau),
        ("<mechanical_reduction>0.5</mechanical_reduction>", 2048, 2048 + 0.5 * TURN / math.tau),
        ("<mechanical_reduction>-1</mechanical_reduction>", 2048, 2048 - TURN / math.tau),
        ("<offset>0.3</offset>", 2048 - 0.3 * TURN / math.tau, 2048 + 0.7 * TURN / math.tau),
        (
            "<mechanical_reduction>0.5</mechanical_reduction><offset>0.3</offset>",
            2048 - 0.15 * TURN / math.tau,
            2048 + 0.35 * TURN / math.tau,
        ),
    ],
    ids=["none", "reduction", "reversed", "offset", "both"],
)
def test_reduction_and_offset_are_applied(inside: str, at_zero: float, at_one: float, tmp_path: Path) -> None:
    files = geared(tmp_path, inside)
    joint = gripper(files)
    assert joint.counts(0.0) == pytest.approx(at_zero, abs=1.0)
    assert joint.counts(1.0) == pytest.approx(at_one, abs=1.0)
    assert joint.position(joint.counts(1.0)) == pytest.approx(1.0, abs=abs(joint.units_per_count))
    assert joint.unit == "rad"
    reference = read_reference(files)["gripper"]
    assert (reference.zero_counts, reference.units_per_count) == (joint.zero_counts, joint.units_per_count)


def test_a_zero_of_the_robot_file_contains_the_offset(tmp_path: Path) -> None:
    own = find_arm("so101").folder / "robot.yaml"
    files = geared(tmp_path, "<offset>0.3</offset>")
    kept = read_arm_servos(find_arm("so101"), files.urdf_path, own)
    assert gripper(kept) == replace(gripper(files), zero_counts=2047)


@pytest.mark.parametrize(
    ("text", "inside", "reason"),
    [
        (
            GEAR.replace("SimpleT", "DifferentialT"),
            "",
            r"gear'> is a transmission_interface/DifferentialTransmission \(",
        ),
        (GEAR.replace("<actuator", '<actuator name="b"/><actuator'), "", "needs one <joint> and one <actuator>"),
        (GEAR.replace("{joint}", "knee"), "", "refers to joint 'knee', which is not in its block"),
        (GEAR, "<mechanical_reduction>0</mechanical_reduction>", "mechanical_reduction must be from 0.001 to 1000"),
        (GEAR, "<offset>far</offset>", r"offset must be a number, not 'far' \(.*arm.urdf, line \d+\)"),
    ],
    ids=["differential", "two actuators", "unknown joint", "no reduction", "no number"],
)
def test_other_transmissions_are_refused(text: str, inside: str, reason: str, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=reason):
        geared(tmp_path, inside, text=text)


def test_a_transmission_outside_ros2_control_is_left_to_other_programs(tmp_path: Path) -> None:
    text = find_arm("so101").urdf.read_text()
    old = '<transmission name="t"><type>transmission_interface/SimpleTransmission</type></transmission></robot>'
    assert not parse_urdf(text.replace("</robot>", old)).components[0].transmissions
