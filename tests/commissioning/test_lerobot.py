"""LeRobot's calibration file is imported and exported without loss, but its zero is not used as the URDF's zero."""

import json
from math import tau
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commissioning.atomic_write import write_whole
from commissioning.calibrate.plan import JointPlan
from commissioning.calibrations import built_signs, calibration_rows, export_calibration, import_calibration
from commissioning.commissioning_errors import CalibrationError
from commissioning.lerobot import LerobotFile, LerobotJoint, lerobot_text, to_lerobot
from commissioning.lerobot_import import Imported, from_lerobot
from drivers.servos.sts import STS3215
from drivers.servos.x import MODELS as X_MODELS
from hal.joint import Joint
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile, calibration_path, load_calibration
from hal.robot_file.robot_file import load_robot_file
from hal.types import JointLimits

RANGES = {
    "shoulder_pan": (-1.920, 1.920),
    "shoulder_lift": (-1.745, 1.745),
    "elbow_flex": (-1.690, 1.690),
    "wrist_flex": (-1.658, 1.658),
    "wrist_roll": (-2.744, 2.841),
    "gripper": (-0.175, 1.745),
}
JOINTS = [
    Joint(name, servo_id, STS3215, JointLimits(lower, upper, 4.7, 12.0, 120.0))
    for servo_id, (name, (lower, upper)) in enumerate(RANGES.items(), 1)
]
BUILT = dict.fromkeys(RANGES, 1)
PLANS = {name: JointPlan(positive="that way") for name in RANGES} | {
    "wrist_roll": JointPlan(positive="that way", zero="pose", pose="jaw level", at=0.0),
    "gripper": JointPlan(positive="opening", zero="lower_stop"),
}
# Values as in published files: a wrist that was not swept, and every zero at 2047.
PUBLISHED = {
    "shoulder_pan": (1, 0, -1386, 743, 3401),
    "shoulder_lift": (2, 0, 1071, 820, 3166),
    "elbow_flex": (3, 0, 1464, 884, 3086),
    "wrist_flex": (4, 0, -1502, 915, 3282),
    "wrist_roll": (5, 0, 120, 0, 4095),
    "gripper": (6, 0, 1256, 2025, 3503),
}
KEYS = ("id", "drive_mode", "homing_offset", "range_min", "range_max")


def content(entries: dict[str, tuple[int, ...]] = PUBLISHED) -> dict[str, dict[str, int]]:
    return {name: dict(zip(KEYS, values, strict=True)) for name, values in entries.items()}


def theirs(entries: dict[str, tuple[int, ...]] = PUBLISHED) -> LerobotFile:
    return {name: LerobotJoint(**entry) for name, entry in content(entries).items()}  # type: ignore[arg-type]


def ours(made: list[Imported]) -> CalibrationFile:
    return CalibrationFile(
        joints={
            one.joint.name: CalibratedJoint(
                servo_id=one.joint.servo_id,
                sign=1 if one.made.sign > 0 else -1,
                zero_counts=one.made.zero_counts,
                homing_offset=one.made.homing_offset,
                lower_counts=one.made.lower_counts,
                upper_counts=one.made.upper_counts,
            )
            for one in made
        }
    )


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "so101.yaml"
    lines = [
        f"  {joint.name}: {{servo_id: {joint.servo_id}, model: sts3215, acceleration: 12.0, jerk: 120.0}}"
        for joint in JOINTS
    ]
    path.write_text("\n".join(["joints:", *lines, ""]))
    return path


def import_text(robot: Path, text: str) -> list[Imported]:
    path = robot.with_name("theirs.json")
    path.write_text(text)
    return import_calibration(path, robot, JOINTS, PLANS)[0]


def test_a_published_file_is_exported_byte_for_byte(robot: Path) -> None:
    text = json.dumps(content(), indent=4)
    import_text(robot, text)
    out = robot.with_name("out.json")
    export_calibration(out, robot)
    assert out.read_text() == text
    assert load_robot_file(robot).joints["gripper"].homing_offset == 1256


def test_the_order_of_joints_is_kept(robot: Path) -> None:
    turned = dict(reversed(content().items()))
    import_text(robot, json.dumps(turned))
    out = robot.with_name("out.json")
    export_calibration(out, robot)
    assert list(json.loads(out.read_text())) == list(turned)


def test_the_zero_is_found_in_the_travel_and_not_at_lerobots_pose() -> None:
    made = {one.joint.name: one for one in from_lerobot(theirs(), JOINTS, BUILT, PLANS)}
    pan = made["shoulder_pan"]
    assert (pan.source, pan.made.zero_counts) == ("middle", 2072)
    assert pan.at_lerobot_zero == pytest.approx((2047 - 2072) * tau / 4096)
    gripper = made["gripper"]  # the closed stop is at 2025 counts, which is -0.175 rad
    assert (gripper.source, gripper.made.zero_counts) == ("lower_stop", round(2025 + 0.175 * 4096 / tau))


def test_lerobots_zero_is_used_and_flagged_if_no_other_is_known() -> None:
    made = {one.joint.name: one for one in from_lerobot(theirs(), JOINTS, BUILT, PLANS)}
    roll = made["wrist_roll"]
    assert (roll.source, roll.made.zero_counts, roll.at_lerobot_zero) == ("lerobot", 2047, 0.0)
    assert "LeRobot's zero is used instead" in roll.doubt
    by_middle = from_lerobot(theirs(), JOINTS, BUILT, PLANS | {"wrist_roll": JointPlan(positive="that way")})
    assert [one.source for one in by_middle if one.joint.name == "wrist_roll"] == ["lerobot"]


def test_a_travel_that_differs_from_the_urdf_is_flagged() -> None:
    made = {one.joint.name: one for one in from_lerobot(theirs(), JOINTS, BUILT, PLANS)}
    assert "its travel is 4.077, but 3.840 in the URDF" in made["shoulder_pan"].doubt
    assert made["elbow_flex"].doubt == ""


def test_drive_mode_reverses_the_joint() -> None:
    entries = PUBLISHED | {"elbow_flex": (3, 1, *PUBLISHED["elbow_flex"][2:]), "gripper": (6, 1, 1256, 1000, 2080)}
    mirrored = BUILT | {"elbow_flex": -1}
    made = {one.joint.name: one.made for one in from_lerobot(theirs(entries), JOINTS, mirrored, PLANS)}
    assert (made["shoulder_pan"].sign, made["elbow_flex"].sign, made["gripper"].sign) == (1, 1, -1)
    # The closed stop is the lower stop of the joint, but has the highest counts.
    assert made["gripper"].zero_counts == round(2080 - 0.175 * 4096 / tau)


anything = st.tuples(st.integers(0, 1), st.integers(-2047, 2047), st.integers(0, 4095), st.integers(0, 4095))
likely = st.builds(
    lambda drive_mode, offset, middle, span: (drive_mode, offset, middle - span // 2, middle + span // 2),
    *(st.integers(0, 1), st.integers(-2047, 2047), st.integers(1950, 2150), st.integers(600, 3600)),
)
entries_of_arms = st.lists(likely, min_size=6, max_size=6) | st.lists(likely | anything, min_size=6, max_size=6)
orders, all_signs = st.permutations(list(RANGES)), st.lists(st.sampled_from((1, -1)), min_size=6, max_size=6)


@given(entries_of_arms, orders, all_signs)
def test_import_then_export_gives_the_same_or_is_refused(
    entries: list[tuple[int, int, int, int]], order: list[str], signs: list[int]
) -> None:
    built = dict(zip(RANGES, signs, strict=True))
    ids = {joint.name: joint.servo_id for joint in JOINTS}
    file = theirs({name: (ids[name], *values) for name, values in zip(order, entries, strict=True)})
    over_the_seam = [name for name, one in file.items() if one.range_min > one.range_max]
    not_moved = [name for name, one in file.items() if one.range_min == one.range_max]
    try:
        made = from_lerobot(file, JOINTS, built, PLANS)
    except CalibrationError as error:
        text = str(error)
        assert all(f"{name}: its range begins at" in text for name in over_the_seam)
        assert all(f"{name}: its range begins and ends at" in text for name in not_moved)
        assert ("the seam" in text or not_moved or "it was moved through" in text) and "nothing was written" in text
        return
    assert over_the_seam == not_moved == []
    assert lerobot_text(to_lerobot(ours(made), built)) == lerobot_text(file)


@given(st.integers(-2047, 2047), st.integers(-400, 200), st.integers(-200, 200), st.sampled_from((1, -1)))
def test_every_homing_offset_of_an_arm_that_works_is_imported(offset: int, low: int, high: int, sign: int) -> None:
    """If the travel is about as long as the range in the URDF, the zero is in its middle, regardless of the offset."""
    ends = 2047 - 1252 + low, 2047 + 1252 + high
    entries = {"shoulder_pan": (1, 0 if sign > 0 else 1, offset, *ends)}
    (one,) = from_lerobot(theirs(entries), JOINTS[:1], BUILT, PLANS)
    assert (one.made.sign, one.made.homing_offset) == (sign, offset)
    assert abs(one.made.zero_counts - sum(ends) / 2) <= 0.5


calibrated = st.builds(
    lambda sign, zero, offset, low, span: (sign, zero, offset, low, min(low + span, 4095)),
    *(st.sampled_from((1, -1)), st.integers(1860, 2240), st.integers(-2047, 2047)),
    *(st.integers(0, 4000), st.integers(1, 4095)),
)


@given(st.lists(calibrated, min_size=6, max_size=6))
def test_export_then_import_gives_the_same_calibration(values: list[tuple[int, int, int, int, int]]) -> None:
    """LeRobot's file cannot contain a zero that was measured in a pose. Such a zero is kept if the file is
    unchanged."""
    calibration = CalibrationFile(
        joints={
            joint.name: CalibratedJoint(
                servo_id=joint.servo_id, sign=1 if sign > 0 else -1, zero_counts=zero, homing_offset=offset,
                lower_counts=low, upper_counts=high,
            )
            for joint, (sign, zero, offset, low, high) in zip(JOINTS, values, strict=True)
        }
    )  # fmt: skip
    made = from_lerobot(to_lerobot(calibration, BUILT), JOINTS, BUILT, PLANS, calibration)
    assert ours(made) == calibration
    assert {one.source for one in made} == {"kept"}


def test_a_calibration_survives_export_and_import(robot: Path) -> None:
    import_text(robot, json.dumps(content()))
    stored = load_calibration(robot)
    assert stored is not None
    # `calibrate` measures this zero at the marked pose
    roll = stored.joints["wrist_roll"].model_copy(update={"zero_counts": 2101})
    changed = CalibrationFile(joints=stored.joints | {"wrist_roll": roll})
    calibration_path(robot).write_text(json.dumps(changed.model_dump()))
    export_calibration(robot.with_name("out.json"), robot)
    import_calibration(robot.with_name("out.json"), robot, JOINTS, PLANS)
    assert load_calibration(robot) == changed


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"gripper": (6, 0, 0, 3900, 200)},
            "gripper: its range begins at 3900 and ends at 200, so it crosses the seam",
        ),
        (
            {"shoulder_pan": (1, 0, 0, 2039, 2047)},
            r"shoulder_pan: it was moved through only 0.012 of 3.840 in the URDF \(counts 2039 to 2047\), so its stops",
        ),
        ({"gripper": (6, 0, 0, 2025, 2600)}, "gripper: it was moved through only 0.882 of 1.920 in the URDF"),
        ({"wrist_roll": (5, 0, 0, 2039, 2047)}, "wrist_roll: it was moved through only 0.012 of 5.585 in the URDF"),
        ({"gripper": (6, 0, 0, 200, 200)}, "gripper: its range begins and ends at 200: the joint was not moved"),
        (
            {"gripper": (6, 0, 2048, 0, 900)},
            r"gripper: the homing offset of its servo \(6\) must be -2047 to 2047, not 2048",
        ),
        ({"gripper": (6, 2, 0, 0, 900)}, "gripper.drive_mode"),
        ({"gripper": (6, 0, 0, -30, 900)}, "gripper: its range must be within 0 to 4095 counts, not -30 to 900"),
        ({"gripper": (7, 0, 0, 30, 900)}, "gripper: its servo has ID 7 in LeRobot's file, but 6 in the robot file"),
        ({"claw": (7, 0, 0, 30, 900)}, "LeRobot's file has joint claw, but the robot file does not"),
        ({"shoulder_pan": (1, 0, 0, 5, 2100)}, "shoulder_pan: with this zero, its limits .* crosses the seam"),
    ],
)
def test_mistakes_are_reported_and_nothing_is_written(
    robot: Path, change: dict[str, tuple[int, ...]], text: str
) -> None:
    with pytest.raises(CalibrationError, match=text):
        import_text(robot, json.dumps(content(PUBLISHED | change)))
    assert not calibration_path(robot).exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not a JSON file"),
        ("[" * 100_000, "not a JSON file"),
        ('{"gripper": {}}', "gripper.id: is missing"),
        ('{"gripper": 1, "gripper": 2}', "duplicate key: gripper"),
        ('{"motor_names": [], "start_pos": []}', "older version of LeRobot"),
        ('{"gripper": {"id": true}}', "gripper.id: true is a boolean, but a number is required"),
    ],
)
def test_an_invalid_file_is_refused(robot: Path, text: str, said: str) -> None:
    with pytest.raises(CalibrationError, match=said):
        import_text(robot, text)


def test_a_missing_joint_is_named(robot: Path) -> None:
    with pytest.raises(CalibrationError, match="the robot file has joint gripper, but LeRobot's file does not"):
        import_text(robot, json.dumps({name: entry for name, entry in content().items() if name != "gripper"}))


def test_a_servo_without_a_homing_offset_cannot_be_exported() -> None:
    dynamixel = Joint("gripper", 6, X_MODELS["xl330-m288"], JOINTS[-1].limits)
    with pytest.raises(CalibrationError, match="xl330-m288 servos do not have the homing offset that"):
        from_lerobot({"gripper": theirs()["gripper"]}, [dynamixel], BUILT, PLANS)
    without = CalibratedJoint(servo_id=6, sign=1, zero_counts=2048, lower_counts=1, upper_counts=2)
    with pytest.raises(CalibrationError, match=r"servo \(6\) has no homing offset"):
        to_lerobot(CalibrationFile(joints={"gripper": without}), BUILT)


def test_a_file_with_a_prefix_is_imported_when_the_prefix_is_named(robot: Path) -> None:
    """The joint names in LeKiwi's file begin with ``arm_``, and the file also contains wheels."""
    wheels = {"base_left_wheel": (7, 0, 0, 0, 4095), "base_right_wheel": (9, 0, 0, 0, 4095)}
    text = json.dumps(content({f"arm_{name}": entry for name, entry in PUBLISHED.items()} | wheels))
    with pytest.raises(CalibrationError, match=r"the names of .* joints begin with arm_: .* with --prefix arm_$"):
        import_text(robot, text)
    path = robot.with_name("theirs.json")
    with pytest.raises(CalibrationError, match=r"no joint name in LeRobot's file begins with leg_.*: arm_shoulder_pan"):
        import_calibration(path, robot, JOINTS, PLANS, "leg_")
    made, _ = import_calibration(path, robot, JOINTS, PLANS, "arm_")
    assert [one.joint.name for one in made] == list(RANGES)


def test_an_unsupported_arm_is_refused_before_the_file_is_read(robot: Path) -> None:
    """The Koch arm has offsets that do not fit the register of a Feetech servo."""
    joints = [Joint(one.name, one.servo_id, X_MODELS["xl330-m288"], one.limits) for one in JOINTS]
    path = robot.with_name("theirs.json")
    path.write_text(json.dumps(content(PUBLISHED | {"gripper": (6, 0, 2050, 0, 900)})))
    with pytest.raises(
        CalibrationError, match=r"cannot be imported for this arm: xl330-m288 servos do not have .* calibrate$"
    ):
        import_calibration(path, robot, joints, PLANS)


def test_an_invalid_offset_is_named_and_can_be_replaced_by_an_import(robot: Path) -> None:
    wild = CalibratedJoint(servo_id=6, sign=1, zero_counts=2048, homing_offset=5000, lower_counts=1, upper_counts=2)
    former = CalibrationFile(joints={"gripper": wild})
    with pytest.raises(
        CalibrationError, match=r"gripper: the homing offset of its servo .* must be -2047 to 2047, not 5000"
    ):
        to_lerobot(former, BUILT)
    made = {one.joint.name: one for one in from_lerobot(theirs(), JOINTS, BUILT, PLANS, former)}
    assert made["gripper"].source == "lower_stop"


def test_the_table_shows_the_imported_values(robot: Path) -> None:
    before = calibration_rows(robot, JOINTS)
    assert {(row.travel, row.doubt) for row in before} == {(None, "not calibrated yet")}
    import_text(robot, json.dumps(content()))
    row = calibration_rows(robot, JOINTS)[2]
    assert (row.joint, row.servo_id) == ("elbow_flex", 3)
    assert row.travel == pytest.approx((3086 - 884) * tau / 4096)
    assert (row.urdf_range, row.doubt) == (pytest.approx(3.38), "")


def test_built_signs_ignore_the_calibration(robot: Path) -> None:
    turned: dict[str, Any] = content(PUBLISHED | {"gripper": (6, 1, 1256, 2025, 3503)})
    import_text(robot, json.dumps(turned))
    assert load_robot_file(robot).joints["gripper"].sign == -1
    assert built_signs(robot) == BUILT


def test_the_previous_file_is_kept_even_if_the_write_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    write_whole(path, "one")
    write_whole(path, "two")
    assert (path.read_text(), (tmp_path / "file.1").read_text()) == ("two", "one")
    monkeypatch.setattr("os.fsync", _no_room)
    with pytest.raises(OSError, match="no room"):
        write_whole(path, "three")
    assert (path.read_text(), sorted(p.name for p in tmp_path.iterdir())) == ("two", ["file", "file.1"])


def _no_room(fd: int) -> None:
    raise OSError("no room")


def test_mistakes_in_both_files_are_reported_with_file_and_line(robot: Path) -> None:
    path = robot.with_name("theirs.json")
    path.write_text(json.dumps(content({**PUBLISHED, "gripper": (6, 0, 1256, 3503, 2025)}), indent=4))
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if "gripper" in text)
    with pytest.raises(CalibrationError, match=rf"theirs.json:{line}: gripper: its range begins at 3503"):
        import_calibration(path, robot, JOINTS, PLANS)
    path.write_text(path.read_text().replace('"id": 6', '"id": "six"'))
    with pytest.raises(CalibrationError, match=rf"theirs.json:{line + 1}: gripper.id: must be"):
        import_calibration(path, robot, JOINTS, PLANS)


def test_a_file_that_is_not_a_mapping_is_reported_without_an_empty_name(robot: Path) -> None:
    path = robot.with_name("theirs.json")
    path.write_text("[1, 2]")
    with pytest.raises(CalibrationError, match=r"theirs.json:1: must be a mapping$"):
        import_calibration(path, robot, JOINTS, PLANS)
