"""Tests of the robot file, its messages, and its combination with the URDF."""

from pathlib import Path

import pytest

from drivers.servos.sts import STS3215
from drivers.servos.x import XL430_W250
from hal.hal_errors import DescriptionError, RobotFileError
from hal.robot_description.description import Description, HardwareInfo, UrdfJoint
from hal.robot_file.robot import Robot, assemble, require_positions
from hal.robot_file.robot_file import BusFile, RobotFile, load_robot_file
from hal.types import JointLimits
from servoloop.stack.robot_files import read_files

CONFIG = Path(__file__).resolve().parents[2] / "config" / "robot_arm.yaml"

GOOD = """\
bus:
  baud: 500000
joints:
  elbow: {servo_id: 1, model: sts3215, sign: -1, zero_counts: 2000, acceleration: 12, jerk: 120}
  finger:
    servo_id: 7
    model: sts3215
    zero_counts: 1024
    metres_per_radian: 0.03
    torque_limit: 0.5
    acceleration: 1.0
    jerk: 20.0
on_exit: {virtual: relax, real: hold}
park:
  velocity_scale: 0.5
  pose: {elbow: 0.1}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.yaml"
    path.write_text(text)
    return path


def loaded(folder: Path, text: str) -> RobotFile:
    return load_robot_file(written(folder, text))


def complaints(folder: Path, text: str) -> list[str]:
    """Return the lines of the error message without the file name."""
    path = written(folder, text)
    with pytest.raises(RobotFileError) as caught:
        load_robot_file(path)
    lines = str(caught.value).splitlines()
    assert all(line.startswith(f"{path}:") for line in lines), lines
    return [line.removeprefix(f"{path}:") for line in lines]


def test_the_values_of_a_robot_file(tmp_path: Path) -> None:
    file = loaded(tmp_path, GOOD)
    assert file.lines()[""].baud == 500_000
    elbow, finger = file.joints["elbow"], file.joints["finger"]
    assert (elbow.servo_id, elbow.sign, elbow.zero_counts, elbow.metres_per_radian) == (1, -1, 2000, None)
    assert (finger.metres_per_radian, finger.torque_limit, finger.jerk) == (0.03, 0.5, 20.0)
    assert (file.on_exit.virtual, file.on_exit.real) == ("relax", "hold")
    assert file.park is not None
    assert (file.park.velocity_scale, file.park.pose) == (0.5, {"elbow": 0.1})


def test_default_values_of_a_robot_file(tmp_path: Path) -> None:
    file = loaded(tmp_path, "joints: {elbow: {servo_id: 1, model: sts3215, acceleration: 12, jerk: 120}}")
    elbow = file.joints["elbow"]
    assert (elbow.sign, elbow.zero_counts, elbow.torque_limit) == (1, None, 1.0)
    assert file.lines() == {"": BusFile(protocol="feetech", baud=1_000_000)}
    assert (file.on_exit.virtual, file.on_exit.real, file.park) == ("hold", "relax", None)


@pytest.mark.parametrize(("line", "on"), [("", True), ("gravity_compensation: false\n", False)])
def test_gravity_compensation_can_be_disabled(tmp_path: Path, line: str, on: bool) -> None:
    arm = read_files(robot=written(tmp_path, CONFIG.read_text() + line)).robot
    assert {joint.gravity_compensation for joint in arm.joints} == {on}
    assert all(joint.compliance is not None for joint in arm.joints)


def test_a_gain_of_the_file_is_used_for_the_servo(tmp_path: Path) -> None:
    dynamixel = CONFIG.with_name("robot_arm_dynamixel.yaml").read_text()
    given, omitted = (
        read_files(robot=written(tmp_path, text)).robot.joints[0].compliance
        for text in (dynamixel, dynamixel.replace("position_p: 2400, ", ""))
    )
    assert given is not None and omitted is not None
    assert given.stiffness == pytest.approx(2400 / 640 * omitted.stiffness)  # 640 is the factory gain of an XL430


def test_the_arm_itself() -> None:
    assert [joint.servo_id for joint in load_robot_file(CONFIG).joints.values()] == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("right", "wrong", "line", "message"),
    [
        ("servo_id: 1,", "servo_id: 254,", 4, "joints.elbow.servo_id: must be at most 253, not 254"),
        ("servo_id: 1,", "servo_id: -1,", 4, "joints.elbow.servo_id: must be at least 0, not -1"),
        ("servo_id: 1,", "servo_id: one,", 4, "joints.elbow.servo_id: must be a whole number, not 'one'"),
        ("servo_id: 1, ", "", 4, "joints.elbow.servo_id: is missing: add the key"),
        (
            "    model: sts3215",
            "    model: sts9999",
            7,
            "joints.finger.model: unknown model sts9999: use one of ",
        ),
        ("sign: -1", "sign: 2", 4, "joints.elbow.sign: must be 1 or -1, not 2"),
        ("zero_counts: 2000", "zero_counts: 40000", 4, "joints.elbow.zero_counts: must be at most 32767"),
        ("metres_per_radian: 0.03", "metres_per_radian: 0", 9, "joints.finger.metres_per_radian: must be above 0"),
        ("metres_per_radian: 0.03", "metres_per_radian: .nan", 9, "joints.finger.metres_per_radian: must be"),
        ("torque_limit: 0.5", "torque_limit: 1.5", 10, "joints.finger.torque_limit: must be at most 1"),
        ("torque_limit: 0.5", "torque_limit: 0", 10, "joints.finger.torque_limit: must be above 0"),
        ("torque_limit: 0.5", "torque_limit: .nan", 10, "joints.finger.torque_limit: must be"),
        ("acceleration: 1.0", "acceleration: .inf", 11, "joints.finger.acceleration: must be"),
        ("jerk: 20.0", "jerk: -20.0", 12, "joints.finger.jerk: must be above 0"),
        ("torque_limit", "torque_limt", 10, "joints.finger.torque_limt: is not a known key"),
        ("baud: 500000", "baud: 0", 2, "bus.baud: must be above 0"),
        ("baud: 500000", "protocol: canopen", 2, "bus.protocol: must be 'feetech'"),
        ("real: hold", "real: drop", 13, "on_exit.real: must be 'hold' or 'relax'"),
        ("velocity_scale: 0.5", "velocity_scale: 2", 15, "park.velocity_scale: must be at most 1"),
        ("elbow: 0.1", "elbow: .nan", 16, "park.pose.elbow: must be a finite number"),
        ("elbow: 0.1", "wrist: 0.1", 14, "park: pose has unknown joints: wrist"),
        ("park:", "parc:", 14, "parc: is not a known key"),
        ("servo_id: 7", "servo_id: 1", 3, "joints: elbow and finger both have servo_id 1"),
    ],
)
def test_a_mistake_is_reported_with_its_line(tmp_path: Path, right: str, wrong: str, line: int, message: str) -> None:
    assert GOOD.count(right) >= 1
    (complaint,) = complaints(tmp_path, GOOD.replace(right, wrong, 1))
    assert complaint.startswith(f"{line}: ")
    assert message in complaint


def test_all_mistakes_are_reported_together(tmp_path: Path) -> None:
    text = GOOD
    for right, wrong in [
        ("baud: 500000", "baud: fast"),
        ("sign: -1", "sign: 0"),
        ("jerk: 20.0", "jerk: soft"),
        ("virtual: relax", "virtual: fall"),
        ("velocity_scale: 0.5", "velocity_scale: 0"),
    ]:
        text = text.replace(right, wrong)
    assert [int(line.split(":")[0]) for line in complaints(tmp_path, text)] == [2, 4, 12, 13, 15]


def test_mistakes_between_entries_are_reported_together(tmp_path: Path) -> None:
    text = GOOD.replace("servo_id: 7", "servo_id: 1").replace("elbow: 0.1", "wrist: 0.1, thumb: 0.1")
    text += "  wrist_2: x\n"
    found = complaints(tmp_path, text.replace("baud: 500000", "baud: 0"))
    assert len(found) == 3
    assert found[0].startswith("2: bus.baud")
    assert "both have servo_id 1" in found[1]
    assert found[2].startswith("17: park.wrist_2")


def test_every_pair_of_joints_with_the_same_servo_is_reported(tmp_path: Path) -> None:
    entry = "{servo_id: %d, model: sts3215, acceleration: 1, jerk: 1}"
    joints = {"a": 1, "b": 1, "c": 2, "d": 2}
    text = "joints:\n" + "".join(f"  {name}: {entry % servo_id}\n" for name, servo_id in joints.items())
    (complaint,) = complaints(tmp_path, text)
    assert "a and b both have servo_id 1" in complaint
    assert "c and d both have servo_id 2" in complaint


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("  finger:", "  elbow:", "5: duplicate key elbow (first in line 4): remove one"),
        ("{elbow: 0.1}", "{elbow: 0.1, elbow: 0.2}", "16: duplicate key elbow (first in line 16): remove one"),
    ],
)
def test_duplicate_keys_are_refused(tmp_path: Path, right: str, wrong: str, message: str) -> None:
    assert complaints(tmp_path, GOOD.replace(right, wrong)) == [message]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must be a mapping"),
        ("- a list", "must be a mapping"),
        ("just a word", "must be a mapping"),
        ("bus: {}", "joints: is missing: add the key"),
        ("joints: [1, 2]", "joints: must be a mapping"),
        ("joints: {elbow: 3}", "joints.elbow: must be"),
    ],
)
def test_files_with_the_wrong_structure(tmp_path: Path, text: str, message: str) -> None:
    (complaint,) = complaints(tmp_path, text)
    assert complaint.startswith("1: ")
    assert message in complaint


def test_invalid_yaml_is_reported_with_its_line(tmp_path: Path) -> None:
    path = written(tmp_path, "bus:\n  baud: [1\njoints: {")
    with pytest.raises(RobotFileError, match=r"robot.yaml is not YAML: [\s\S]*line 3"):
        load_robot_file(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: {a: 2024-13-45}", " is not YAML: the value '2024-13-45' is not a valid timestamp .line 1"),
        ("joints: &x {a: *x}", ":1: the file contains itself or is nested too deeply"),
        ("joints: " + "[" * 3000, ":1: the file contains itself or is nested too deeply"),
    ],
    ids=["no date", "itself", "deep"],
)
def test_unusable_yaml_is_reported(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RobotFileError, match=f"robot.yaml{message}"):
        load_robot_file(written(tmp_path, text))


@pytest.mark.parametrize("name", ["absent.yaml", ".", "n" * 256, "n" * 256 + "/robot.yaml"])
def test_unreadable_files_are_reported_with_the_reason(tmp_path: Path, name: str) -> None:
    with pytest.raises(RobotFileError, match=r"cannot read .*: (No such file|Is a directory|File name too long)"):
        load_robot_file(tmp_path / name)


def test_a_name_that_is_too_long_for_a_calibration_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / f"{'n' * 250}.yaml"
    path.write_text(GOOD)
    assert load_robot_file(path).joints


def test_binary_files_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(RobotFileError, match=r"robot\.yaml"):
        load_robot_file(path)


DYNAMIXEL = GOOD.replace("sts3215", "xl430-w250").replace("baud: 500000", "protocol: dynamixel")


def test_a_dynamixel_arm(tmp_path: Path) -> None:
    file = loaded(tmp_path, DYNAMIXEL.replace("servo_id: 1,", "servo_id: 1, position_p: 2400,"))
    assert file.lines()[""].protocol == "dynamixel"
    assert [joint.position_p for joint in file.joints.values()] == [2400, None]
    assert {joint.model for joint in joined(tmp_path, ELBOW, FINGER, text=DYNAMIXEL).joints} == {XL430_W250}


def test_a_virtual_dynamixel_has_the_firmware_that_the_file_names(tmp_path: Path) -> None:
    text = DYNAMIXEL.replace("servo_id: 1,", "servo_id: 1, firmware: 44,")
    assert [joint.firmware for joint in joined(tmp_path, ELBOW, FINGER, text=text).joints] == [44, None]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (DYNAMIXEL.replace("xl430-w250", "sts3215", 1), "elbow has model sts3215, which does not use the protocol of"),
        (GOOD.replace("sts3215", "xl430-w250", 1), "elbow has model xl430-w250, which does not use the protocol of"),
        (
            DYNAMIXEL.replace("servo_id: 1,", "servo_id: 253,"),
            "elbow has servo_id 253, but the highest dynamixel ID is 252",
        ),
        (GOOD.replace("servo_id: 1,", "servo_id: 1, position_p: 32,"), "elbow has position_p, but only Dynamixel"),
        (
            GOOD.replace("servo_id: 1,", "servo_id: 1, firmware: 44,"),
            "elbow has firmware, but the firmware version can be set only for a virtual Dynamixel",
        ),
    ],
)
def test_servos_that_do_not_fit_their_bus(tmp_path: Path, text: str, message: str) -> None:
    (complaint,) = complaints(tmp_path, text)
    assert complaint.startswith("3: joints: ")
    assert message in complaint


# Combination with the URDF

ELBOW = UrdfJoint("elbow", "revolute", "a", "b", (0, 0, 0), (0, 0, 0), (0, 0, 1), -1.5, 1.5, 4.0, None)
FINGER = UrdfJoint("finger", "prismatic", "b", "c", (0, 0, 0), (0, 0, 0), (0, 0, 1), 0.0, 0.05, 0.2, None)


def joined(folder: Path, *urdf: UrdfJoint, text: str = GOOD) -> Robot:
    commands = {joint.name: ("position",) for joint in urdf} | {"follower": ()}
    component = HardwareInfo("arm", "system", "plugin", {}, commands, {}, frozenset(["follower"]))
    return assemble(loaded(folder, text), Description("", {j.name: j for j in urdf}, (component,)), component)


def changed(joint: UrdfJoint, **changes: object) -> UrdfJoint:
    values = {name: getattr(joint, name) for name in UrdfJoint.__slots__}
    return UrdfJoint(**{**values, **changes})  # type: ignore[arg-type]


def test_joints_combine_the_urdf_and_the_robot_file(tmp_path: Path) -> None:
    robot = joined(tmp_path, FINGER, ELBOW)
    finger, elbow = robot.joints
    assert (finger.name, finger.servo_id, finger.transmission, finger.torque_limit) == ("finger", 7, 0.03, 0.5)
    assert (elbow.name, elbow.servo_id, elbow.sign, elbow.zero_counts) == ("elbow", 1, -1, 2000)
    assert elbow.model is STS3215
    assert elbow.transmission == 1.0
    assert robot.limits() == {
        "finger": JointLimits(0.0, 0.05, 0.2, 1.0, 20.0),
        "elbow": JointLimits(-1.5, 1.5, 4.0, 12.0, 120.0),
    }


@pytest.mark.parametrize(
    ("urdf", "message"),
    [
        ((ELBOW,), "the robot file has a servo for finger, but the URDF does not command it"),
        ((ELBOW, FINGER, changed(ELBOW, name="wrist")), "the URDF commands wrist, but the robot file has no"),
        ((ELBOW, changed(FINGER, kind="revolute")), "finger is revolute in the URDF and must not have metres_per_r"),
        ((changed(ELBOW, kind="prismatic"), FINGER), "elbow is prismatic in the URDF and needs metres_per_radian"),
        ((changed(ELBOW, kind="fixed"), FINGER), "elbow is fixed in the URDF"),
        (
            (changed(ELBOW, upper=3.3), FINGER),
            "elbow: the limits correspond to counts -151 to 2977, but the servo has only 0 to 4095",
        ),
        ((ELBOW, changed(FINGER, upper=0.2)), "finger: the limits correspond to counts 1024 to 5369"),
        ((changed(ELBOW, lower=0.2), FINGER), "park.pose: 0.1 is outside the limits 0.2 to 1.5 of elbow"),
    ],
)
def test_contradictions_between_urdf_and_robot_file_are_reported(
    tmp_path: Path, urdf: tuple[UrdfJoint, ...], message: str
) -> None:
    with pytest.raises(RobotFileError) as caught:
        joined(tmp_path, *urdf)
    (complaint,) = str(caught.value).splitlines()
    assert message in complaint


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        (
            ("position", "velocity"),
            "the URDF has the command interface elbow/velocity, but servos take only positions: use a",
        ),
        (
            ("effort",),
            "the URDF has the command interface elbow/effort, but servos take only positions: use a",
        ),
        ((), "elbow has no command interface and is not a mimic joint: add a position command interface"),
    ],
)
def test_servos_take_positions_only(commands: tuple[str, ...], message: str) -> None:
    component = HardwareInfo("arm", "system", "plugin", {}, {"elbow": commands, "finger": ("position",)}, {})
    with pytest.raises(DescriptionError) as caught:
        require_positions(component)
    assert str(caught.value).startswith(f"arm: {message}")


def test_a_component_without_joints_is_refused() -> None:
    with pytest.raises(DescriptionError, match=r"^arm: the block has no joint"):
        require_positions(HardwareInfo("arm", "system", "plugin", {}, {}, {}))


def test_all_contradictions_are_reported_together(tmp_path: Path) -> None:
    wrist = changed(ELBOW, name="wrist")
    with pytest.raises(RobotFileError) as caught:
        joined(tmp_path, changed(ELBOW, kind="prismatic"), wrist)
    assert len(str(caught.value).splitlines()) == 3


# Several buses

TWO = """buses:
  arm: {protocol: feetech}
  hand: {protocol: dynamixel, baud: 57600}
joints:
  a: {bus: arm, servo_id: 1, model: sts3215, acceleration: 1.0, jerk: 1.0}
  b: {bus: hand, servo_id: 1, model: xl430-w250, position_p: 900, acceleration: 1.0, jerk: 1.0}
"""


def test_several_buses_of_two_makes_with_the_same_ids(tmp_path: Path) -> None:
    file = loaded(tmp_path, TWO)
    assert file.lines() == {"arm": BusFile(), "hand": BusFile(protocol="dynamixel", baud=57600)}
    assert list(file.joints_on("arm")) == ["a"] and list(file.joints_on("hand")) == ["b"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "buses:",
            "bus: {}\nbuses:",
            "robot.yaml:2: buses: the file has both bus and buses: list every bus under buses",
        ),
        ("bus: arm, ", "", "robot.yaml:4: joints: a has no bus: use one of arm, hand; no joint is on bus arm"),
        ("bus: hand, ", "bus: foot, ", "b is on unknown bus foot: use one of arm, hand; no joint is on bus hand"),
        ("bus: hand, ", "bus: arm, ", "a and b both have servo_id 1 on bus arm; b has model xl430-w250, which does"),
        ("  hand: {", "  ha/nd: {", "robot.yaml:3: buses.ha/nd"),
        ("  hand: {", "  world: {", "a bus must not be called world"),
        ("protocol: feetech", "protocol: morse", "robot.yaml:2: buses.arm.protocol"),
    ],
)
def test_mistakes_with_several_buses_are_reported_with_their_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in TWO
    with pytest.raises(RobotFileError) as caught:
        loaded(tmp_path, TWO.replace(old, new))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ("servo_id: 1, model: sts3215", "a and b both have servo_id 1 on bus arm"),
        ("servo_id: 2, model: scs15", "a and b cannot share a bus"),
    ],
)
def test_a_joint_without_a_bus_is_on_the_only_bus(tmp_path: Path, second: str, message: str) -> None:
    text = f"""buses: {{arm: {{}}}}
joints:
  a: {{servo_id: 1, model: sts3215, acceleration: 1.0, jerk: 1.0}}
  b: {{bus: arm, {second}, acceleration: 1.0, jerk: 1.0}}
"""
    (complaint,) = complaints(tmp_path, text)
    assert message in complaint


@pytest.mark.parametrize("offset", ["-2047", "0", "2047"])
def test_valid_homing_offsets(tmp_path: Path, offset: str) -> None:
    file = loaded(tmp_path, GOOD.replace("servo_id: 1,", f"servo_id: 1, homing_offset: {offset},"))
    assert file.joints["elbow"].homing_offset == int(offset)


@pytest.mark.parametrize(
    ("model", "offset", "message"),
    [
        ("scs15", 0, "elbow: scs15 has no homing_offset: remove it"),
        ("sts3215", 2048, "elbow: homing_offset must be -2047 to 2047, not 2048"),
    ],
)
def test_invalid_homing_offsets_are_refused(tmp_path: Path, model: str, offset: int, message: str) -> None:
    text = GOOD.replace("servo_id: 1,", f"servo_id: 1, homing_offset: {offset},").replace("sts3215", model)
    (complaint,) = complaints(tmp_path, text)
    assert message in complaint
    found = f"servo_id: 1, sign: 1, zero_counts: 2048, homing_offset: {offset}, lower_counts: 0, upper_counts: 4095"
    (tmp_path / "robot.calibration.yaml").write_text(f"joints: {{elbow: {{{found}}}}}\n")
    with pytest.raises(RobotFileError, match=rf"robot.calibration.yaml:1: {message}[\s\S]*calibrate again"):
        loaded(tmp_path, GOOD.replace("sts3215", model))


def test_a_joint_must_not_have_a_bus_in_the_short_form(tmp_path: Path) -> None:
    text = TWO[TWO.index("joints:") :].replace("  b: {bus: hand", "  b: {servo_id: 2, bus: hand", 1)
    with pytest.raises(RobotFileError, match="a is on bus arm, but the file has no buses"):
        loaded(
            tmp_path,
            text.replace("servo_id: 2, bus: hand, servo_id: 1", "servo_id: 2")
            .replace("xl430-w250", "sts3215")
            .replace(", position_p: 900", ""),
        )


@pytest.mark.parametrize(
    ("model", "protocol", "middle"),
    [("scs0009", "feetech", 512), ("ax-12a", "dynamixel", 512), ("mx-28", "dynamixel", 2048)],
)
def test_zero_counts_is_the_middle_of_the_range_by_default(
    tmp_path: Path, model: str, protocol: str, middle: int
) -> None:
    text = (
        GOOD.replace("sts3215", model)
        .replace("baud: 500000", f"protocol: {protocol}")
        .replace("zero_counts: 2000, ", "")
    )
    assert (
        joined(tmp_path, ELBOW, FINGER, text=text.replace("    zero_counts: 1024\n", "")).joints[0].zero_counts
        == middle
    )


def test_limits_beyond_the_range_of_the_encoder_are_refused(tmp_path: Path) -> None:
    text = GOOD.replace("sts3215", "scs0009").replace("zero_counts: 2000", "zero_counts: 1000")
    with pytest.raises(RobotFileError, match="the servo has only 0 to 1023"):
        joined(tmp_path, ELBOW, FINGER, text=text)


@pytest.mark.parametrize(
    ("protocol", "one", "other"), [("feetech", "sts3215", "scs15"), ("dynamixel", "xl430-w250", "mx-28")]
)
def test_servos_with_different_protocols_cannot_share_a_bus(
    tmp_path: Path, protocol: str, one: str, other: str
) -> None:
    text = GOOD.replace("sts3215", other).replace(other, one, 1).replace("baud: 500000", f"protocol: {protocol}")
    (complaint,) = complaints(tmp_path, text)
    assert "elbow and finger cannot share a bus" in complaint


def crowd(count: int, model: str, bus: str = "") -> str:
    """Return the joints of a file in which one bus has many servos of one model."""
    place = f"bus: {bus}, " if bus else ""
    values = "acceleration: 1.0, jerk: 10.0"
    return "".join(f"  {model}-{i}: {{{place}servo_id: {i}, model: {model}, {values}}}\n" for i in range(count))


@pytest.mark.parametrize(("model", "most"), [("sts3215", 31), ("scs15", 35), ("ax-12a", 50), ("xl430-w250", 253)])
def test_a_bus_has_no_more_servos_than_fit_into_one_goal_packet(tmp_path: Path, model: str, most: int) -> None:
    protocol = "feetech" if model.startswith("s") else "dynamixel"
    begin = f"bus: {{protocol: {protocol}}}\njoints:\n"
    assert len(load_robot_file(written(tmp_path, begin + crowd(most, model))).joints) == most
    if most < 253:
        message = (
            f"robot.yaml:2: joints: the bus has {most + 1} servos of the series .*, but a packet holds at most {most} "
            "goals: connect some of these servos to another bus$"
        )
        with pytest.raises(RobotFileError, match=message):
            load_robot_file(written(tmp_path, begin + crowd(most + 1, model)))


def test_each_bus_has_its_own_packet(tmp_path: Path) -> None:
    begin = "buses: {a: {}, b: {}}\njoints:\n"
    load_robot_file(written(tmp_path, begin + crowd(31, "sts3215", "a") + crowd(31, "sts3250", "b")))
    with pytest.raises(RobotFileError, match="joints: bus b has 32 servos of the series sts,"):
        load_robot_file(written(tmp_path, begin + crowd(31, "sts3215", "a") + crowd(32, "sts3250", "b")))


def test_numbers_as_names_must_be_in_quotes(tmp_path: Path) -> None:
    found = complaints(tmp_path, GOOD.replace("  finger:", "  1:"))
    assert any("1 is read as a number: put the text in quotes ('1')" in complaint for complaint in found)
