"""Files of recorded motions, and the commands that list and delete them."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from controller.teach.hand_path import HandPath
from drivers.driver_errors import DriverError
from servoloop.cli import app
from servoloop.stack.shipped_files import ARMS
from servoloop.teach.motion_files import LONGEST_NAME, MotionStore, RecordedMotion, TeachError, beyond, check_duration
from tests.teach.rig import SO101

JOINTS = {joint.name: joint for joint in SO101.robot.joints}
NAMES = tuple(JOINTS)
LIMITS = [joint.limits for joint in SO101.robot.joints]
POSITION = np.array([[0.0, -0.9, 0.3, 0.6, 0.0, 0.1], [0.123456, -0.8, 0.2, 0.6, 0.0, 0.1]])
POSES = RecordedMotion(NAMES, POSITION)
PATH = RecordedMotion(NAMES, POSITION, HandPath(np.array([0.0, 1.5]), POSITION, np.zeros((2, 6))))


@pytest.fixture
def motions(tmp_path: Path) -> MotionStore:
    motions = MotionStore(tmp_path)
    motions.require_writable()
    return motions


@pytest.mark.parametrize("motion", [POSES, PATH])
def test_saved_motion_is_read_back_unchanged(motions: MotionStore, motion: RecordedMotion) -> None:
    motions.save("wave", motion, JOINTS)
    back = motions.get("wave")
    assert back.joints == NAMES and back.position == pytest.approx(motion.position, abs=1e-5)
    assert (back.path is None) == (motion.path is None)
    if back.path is not None:
        assert back.path.duration_s == 1.5 and not back.path.velocity.any()
    text = motions.path("wave").read_text()
    assert text.startswith("version: 2\njoints: [shoulder_pan, ") and "0.12346" in text


def test_previous_version_is_kept_and_deleted_with_the_motion(motions: MotionStore) -> None:
    motions.save("wave", POSES, JOINTS)
    motions.save("wave", PATH, JOINTS)
    former = motions.path("wave").with_name("wave.yaml.1")
    assert "at_s" not in former.read_text() and list(motions.all()) == ["wave"]
    motions.remove("wave")
    assert not former.exists() and not motions.all()


def test_unknown_and_invalid_names_are_explained(motions: MotionStore) -> None:
    with pytest.raises(TeachError, match=r"there is no motion wave .* none"):
        motions.get("wave")
    motions.save("nod", POSES, JOINTS)
    with pytest.raises(TeachError, match="motions: nod"):
        motions.remove("wave")
    for name in ("../wave", "", "a b", "wave.yaml", "w" * (LONGEST_NAME + 1)):
        with pytest.raises(TeachError, match=f"use only letters, digits, _ and -, and at most {LONGEST_NAME} of them"):
            motions.save(name, POSES, JOINTS)


def test_the_longest_name_can_be_saved_twice_and_deleted(motions: MotionStore) -> None:
    name = "w" * LONGEST_NAME
    motions.save(name, POSES, JOINTS)
    motions.save(name, PATH, JOINTS)
    motions.remove(name)
    assert not motions.all()


def test_a_motion_that_cannot_be_deleted_is_reported(motions: MotionStore) -> None:
    motions.save("wave", POSES, JOINTS)
    motions.path("wave").with_name("wave.yaml.1").mkdir()
    with pytest.raises(TeachError, match=r"cannot remove .*wave\.yaml\.1: Is a directory"):
        motions.remove("wave")


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ("[]", r":4: points"),
        ("[{positions: [0.0, 1.0]}]", "points.0 needs 1 positions"),
        ("[{positions: [.nan]}]", "positions.0"),
        ("[{at_s: 0.0, positions: [0.0], velocities: [0.0]}]", "at least two points"),
        ("[{at_s: 0.0, positions: [0.0], velocities: [0.0]}, {positions: [0.0]}]", "all with at_s"),
        (
            "[{at_s: 0.0, positions: [0.0], velocities: [0.0]}, {at_s: 0.0, positions: [0.0], velocities: [0.0]}]",
            "increase",
        ),
        (
            "[{at_s: 1.0, positions: [0.0], velocities: [0.0]}, {at_s: 2.0, positions: [0.0], velocities: [0.0]}]",
            "at 0",
        ),
        ("[{at_s: 0.0, positions: [0.0]}, {at_s: 2.0, positions: [0.0]}]", "1 velocities"),
        ("[{positions: [0.0], speed: 3}]", "speed"),
        (
            "[{at_s: 0.0, positions: [0.0], velocities: [0.0]}, {at_s: 1e9, positions: [0.0], velocities: [0.0]}]",
            "points.1.at_s: .* 3600",
        ),
        (
            "[{at_s: 0.0, positions: [0.0], velocities: [0.0]}, {at_s: 1e7, positions: [0.0], velocities: [0.0]}]",
            "points.1.at_s: .* 3600",
        ),
    ],
)
def test_file_with_a_mistake_is_refused_with_its_line(motions: MotionStore, points: str, message: str) -> None:
    motions.path("wave").write_text(f"version: 2\njoints: [wrist]\nunits: {{wrist: rad}}\npoints: {points}\n")
    with pytest.raises(TeachError, match=message) as refused:
        motions.get("wave")
    assert str(motions.path("wave")) in str(refused.value)


def test_another_version_is_refused(motions: MotionStore) -> None:
    motions.path("wave").write_text("version: 3\njoints: [wrist]\nunits: {wrist: rad}\npoints: [{positions: [0.0]}]\n")
    with pytest.raises(TeachError, match="version"):
        motions.get("wave")


@pytest.mark.parametrize("head", ["version: 1\n", "", "version: 2\n"])
def test_joints_in_a_mapping_are_refused(motions: MotionStore, head: str) -> None:
    motions.path("wave").write_text(f"{head}joints: {{wrist: rad, arm: rad}}\npoints: [{{positions: [0.0, 1.0]}}]\n")
    with pytest.raises(TeachError, match=r"wave.yaml.*Another program may have changed the order.*record the motion"):
        motions.get("wave")


@pytest.mark.parametrize("motion", [POSES, PATH])
def test_sorted_keys_do_not_change_the_meaning_of_a_file(motions: MotionStore, motion: RecordedMotion) -> None:
    motions.save("wave", motion, JOINTS)
    content = yaml.safe_load(motions.path("wave").read_text())
    motions.path("wave").write_text(yaml.safe_dump(content, sort_keys=True))
    back = motions.get("wave").of(NAMES, "wave")
    assert back.joints == NAMES and back.position == pytest.approx(motion.position, abs=1e-5)


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ("joints: [wrist, wrist]\nunits: {wrist: rad}", "lists a joint twice"),
        ("joints: [wrist]\nunits: {}", "units has no joint"),
        ("joints: [wrist]\nunits: {arm: rad}", "units has arm, but joints has wrist"),
    ],
)
def test_each_joint_has_one_name_and_one_unit(motions: MotionStore, head: str, message: str) -> None:
    motions.path("wave").write_text(f"version: 2\n{head}\npoints: [{{positions: [0.0]}}]\n")
    with pytest.raises(TeachError, match=message):
        motions.get("wave")


def test_unit_different_from_the_arm_is_refused(motions: MotionStore) -> None:
    motions.save("wave", POSES, JOINTS)
    motions.get("wave").check_units(SO101.robot.joints, "wave")
    text = motions.path("wave").read_text()
    motions.path("wave").write_text(text.replace("gripper: rad", "gripper: m"))
    with pytest.raises(TeachError, match="gripper is in m, but the arm's joint is in rad"):
        motions.get("wave").check_units(SO101.robot.joints, "wave")


def test_joints_are_reordered_and_unknown_joints_are_refused() -> None:
    turned = PATH.of(NAMES[::-1], "wave")
    assert turned.path is not None and turned.position[1, -1] == turned.path.position[1, -1] == pytest.approx(0.123456)
    with pytest.raises(
        TeachError, match=r"wave was recorded on a different arm: it has no wrist; the arm has no gripper\."
    ):
        PATH.of([*NAMES[:-1], "wrist"], "wave")


def test_positions_beyond_the_limits_are_refused_and_name_each_joint() -> None:
    POSES.check(LIMITS, "wave")
    far = POSITION.copy()
    far[0, 0], far[1, 2] = -3.0, 2.5
    with pytest.raises(TeachError, match=r"wave: shoulder_pan would go to -3.0000.*; elbow_flex would go to 2.5000"):
        RecordedMotion(NAMES, far).check(LIMITS, "wave")
    (first, second) = beyond(far, NAMES, LIMITS)
    assert first.startswith("shoulder_pan went 1.080 beyond") and second.startswith("elbow_flex went 0.8")


def path_through(times_s: list[float], pan: list[float], velocity: list[float]) -> RecordedMotion:
    """Return a path of the first joint; the other joints are at rest."""
    position, slopes = np.tile(POSITION[0], (len(pan), 1)), np.zeros((len(pan), 6))
    position[:, 0], slopes[:, 0] = pan, velocity
    return RecordedMotion(NAMES, position, HandPath(np.array(times_s), position, slopes))


JUMPS = [
    (
        path_through([0.0, 1.0, 1.02, 2.0], [0.0, 0.3, 1.2, 1.5], [0.0] * 4),
        r"shoulder_pan jumps by \+0.9000 rad .* 1 and 2",
    ),
    (path_through([0.0, 0.00001, 2.0], [0.0, 0.01, 0.5], [0.0] * 3), r"jumps by \+0.0100 rad in 0.0000 s .* 0 and 1"),
    (path_through([0.0, 1.0, 2.0], [0.0, 0.1, 0.2], [0.0, -35.0, 0.0]), r"between points 0 and 1 \(35 rad/s\)"),
    (path_through([0.0, 2.0, 4.0], [1.5, 1.5, 1.5], [0.0, 8.0, 0.0]), "shoulder_pan would exceed its limits"),
]


@pytest.mark.parametrize(("motion", "message"), JUMPS)
def test_implausible_path_is_refused_with_joint_and_line(motion: RecordedMotion, message: str) -> None:
    with pytest.raises(TeachError, match=f"wave: .*{message}"):
        motion.check(LIMITS, "wave")


def test_errors_have_the_lines_of_the_points(motions: MotionStore) -> None:
    """Points start in line 5. A point of a path takes three lines in the file, and a pose one line."""
    far = POSITION.copy()
    far[1, 0] = 4.0
    for motion, message in (
        (JUMPS[0][0], r"between points 1 \(line 8\) and 2 \(line 11\)"),
        (JUMPS[3][0], r"between points 1 \(line 8\) and 2 \(line 11\), whose velocities do not match"),
        (RecordedMotion(NAMES, far), r"shoulder_pan would go to 4.0000 at point 1 \(line 6\)"),
    ):
        motions.save("wave", motion, JOINTS)
        with pytest.raises(TeachError, match=rf"wave.yaml: .*{message}"):
            motions.get("wave").check(LIMITS, str(motions.path("wave")))
    text = motions.path("wave").read_text()
    motions.path("wave").write_text(text.replace("gripper: rad", "gripper: m"))
    with pytest.raises(TeachError, match=r"gripper is in m, but the arm's joint is in rad \(line 3\)"):
        motions.get("wave").check_units(SO101.robot.joints, "wave")


def test_motion_longer_than_the_longest_goal_is_refused() -> None:
    check_duration(3600.0, "wave")
    with pytest.raises(TeachError, match=r"wave would take 3700 s, .* 3600 s: play it faster, or record it in parts"):
        check_duration(3700.0, "wave")


def test_a_fast_hand_is_not_refused() -> None:
    path_through([0.0, 0.1, 0.2], [0.0, 0.6, 1.2], [0.0, 9.0, 0.0]).check(LIMITS, "wave")


def test_unwritable_folder_is_reported_before_anything_moves(tmp_path: Path) -> None:
    (tmp_path / "taught").write_text("in the way")
    with pytest.raises(DriverError, match="cannot write into"):
        MotionStore(tmp_path).require_writable()


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """Return a user's arm with a motion."""
    (tmp_path / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'so101'}\n")
    motions = MotionStore(tmp_path)
    motions.require_writable()
    motions.save("wave", PATH, JOINTS)
    return tmp_path


def test_commands_list_and_delete_motions(arm: Path) -> None:
    run = CliRunner().invoke
    assert run(app, ["teach", "list", "--arm", str(arm)]).output == "wave: a path of 1.5 s through 2 points\n"
    (found,) = json.loads(run(app, ["teach", "list", "--arm", str(arm), "--json"]).output).values()
    assert found == {"kind": "path", "joints": list(NAMES), "points": 2, "duration_s": 1.5}
    assert run(app, ["teach", "remove", "wave", "--arm", str(arm)]).exit_code == 0
    assert run(app, ["teach", "list", "--arm", str(arm)]).output.startswith("no motions are saved in ")


def test_bad_files_do_not_hide_the_other_motions_and_can_be_deleted(arm: Path) -> None:
    motions = MotionStore(arm)
    copy = motions.path("wave").with_name("wave copy.yaml")
    for path in (copy, motions.path("broken")):
        path.write_text("version: 1\n")

    def listed(*options: str) -> tuple[str, str]:
        result = CliRunner().invoke(app, ["teach", "list", "--arm", str(arm), *options])
        assert isinstance(result.exception, TeachError)
        return result.output, str(result.exception)

    output, error = listed()
    assert output == "wave: a path of 1.5 s through 2 points\n"
    assert f"{motions.path('broken')}:1: version" in error and f"{copy}: 'wave copy' is not a valid name" in error
    assert list(json.loads(listed("--json")[0])) == ["wave"]
    assert CliRunner().invoke(app, ["teach", "remove", "broken", "--arm", str(arm)]).exit_code == 0
    assert not motions.path("broken").exists()


def test_play_refuses_before_it_opens_a_port(arm: Path) -> None:
    def refused(*words: str) -> str:
        with pytest.raises(DriverError) as error:
            CliRunner().invoke(app, ["teach", "play", *words, "--port", "./no_such_port"], catch_exceptions=False)
        return str(error.value)

    motions = MotionStore(arm)
    motions.save("jump", JUMPS[0][0], JOINTS)
    assert "shoulder_pan jumps by" in refused("jump", "--arm", str(arm), "--hands-free")
    motions.save("metres", POSES, JOINTS)
    motions.path("metres").write_text(motions.path("metres").read_text().replace("gripper: rad", "gripper: m"))
    assert "gripper is in m" in refused("metres", "--arm", str(arm), "--hands-free")
    assert "no key can be held because stdin is not a terminal" in refused("wave", "--arm", str(arm))
    for unattended in ("--hands-free", "--yes"):
        assert "there is no motion nod" in refused("nod", "--arm", str(arm), unattended)
    assert "no_such_port" in refused("wave", "--arm", str(arm), "--hands-free")


def test_overwriting_needs_confirmation_and_invalid_names_are_refused_first(arm: Path) -> None:
    run = CliRunner().invoke
    words = ["teach", "record", "wave", "--arm", str(arm), "--port", "./no_such_port"]
    asked = run(app, words, input="n\n")
    assert asked.exit_code == 1 and "The motion wave already exists. Replace it?" in asked.output
    with pytest.raises(TeachError, match="is not a valid name"):
        run(app, ["teach", "record", "a b", *words[3:]], catch_exceptions=False)
