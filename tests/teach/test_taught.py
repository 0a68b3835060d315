"""The files of what an arm was taught, and the verbs that list and forget them."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from controller.teach.hand_path import HandPath
from drivers.errors import DriverError
from servoloop.cli import app
from servoloop.stack.arm_folders import ARMS
from servoloop.teach.taught import Taught, TaughtMotions, TeachError, beyond, check_duration
from tests.teach.rig import SO101

JOINTS = {joint.name: joint for joint in SO101.robot.joints}
NAMES = tuple(JOINTS)
LIMITS = [joint.limits for joint in SO101.robot.joints]
POSITION = np.array([[0.0, -0.9, 0.3, 0.6, 0.0, 0.1], [0.123456, -0.8, 0.2, 0.6, 0.0, 0.1]])
POSES = Taught(NAMES, POSITION)
PATH = Taught(NAMES, POSITION, HandPath(np.array([0.0, 1.5]), POSITION, np.zeros((2, 6))))


@pytest.fixture
def motions(tmp_path: Path) -> TaughtMotions:
    motions = TaughtMotions(tmp_path)
    motions.require_writable()
    return motions


@pytest.mark.parametrize("taught", [POSES, PATH])
def test_what_is_kept_comes_back(motions: TaughtMotions, taught: Taught) -> None:
    motions.save("wave", taught, JOINTS)
    back = motions.get("wave")
    assert back.joints == NAMES and back.position == pytest.approx(taught.position, abs=1e-5)
    assert (back.path is None) == (taught.path is None)
    if back.path is not None:
        assert back.path.duration_s == 1.5 and not back.path.velocity.any()
    text = motions.path("wave").read_text()
    assert text.startswith("version: 2\njoints: [shoulder_pan, ") and "0.12346" in text


def test_the_one_before_stays_beside_a_new_one_and_goes_with_it(motions: TaughtMotions) -> None:
    motions.save("wave", POSES, JOINTS)
    motions.save("wave", PATH, JOINTS)
    former = motions.path("wave").with_name("wave.yaml.1")
    assert "at_s" not in former.read_text() and list(motions.all()) == ["wave"]
    motions.remove("wave")
    assert not former.exists() and not motions.all()


def test_an_unknown_name_and_a_bad_one_are_errors_that_help(motions: TaughtMotions) -> None:
    with pytest.raises(TeachError, match=r"nothing was taught as wave .* none yet"):
        motions.get("wave")
    motions.save("nod", POSES, JOINTS)
    with pytest.raises(TeachError, match="but: nod"):
        motions.remove("wave")
    for name in ("../wave", "", "a b", "wave.yaml"):
        with pytest.raises(TeachError, match="letters, digits, _ and -"):
            motions.save(name, POSES, JOINTS)


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ("[]", r":4: points"),
        ("[{positions: [0.0, 1.0]}]", "points.0 needs 1 positions"),
        ("[{positions: [.nan]}]", "positions.0"),
        ("[{at_s: 0.0, positions: [0.0], velocities: [0.0]}]", "two points or more"),
        ("[{at_s: 0.0, positions: [0.0], velocities: [0.0]}, {positions: [0.0]}]", "each with at_s"),
        (
            "[{at_s: 0.0, positions: [0.0], velocities: [0.0]}, {at_s: 0.0, positions: [0.0], velocities: [0.0]}]",
            "grow",
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
def test_a_file_with_a_mistake_is_refused_with_its_place(motions: TaughtMotions, points: str, said: str) -> None:
    motions.path("wave").write_text(f"version: 2\njoints: [wrist]\nunits: {{wrist: rad}}\npoints: {points}\n")
    with pytest.raises(TeachError, match=said) as refused:
        motions.get("wave")
    assert str(motions.path("wave")) in str(refused.value)


def test_another_version_is_refused(motions: TaughtMotions) -> None:
    motions.path("wave").write_text("version: 3\njoints: [wrist]\nunits: {wrist: rad}\npoints: [{positions: [0.0]}]\n")
    with pytest.raises(TeachError, match="version"):
        motions.get("wave")


@pytest.mark.parametrize("head", ["version: 1\n", "", "version: 2\n"])
def test_joints_in_a_mapping_are_refused_as_without_an_order(motions: TaughtMotions, head: str) -> None:
    motions.path("wave").write_text(f"{head}joints: {{wrist: rad, arm: rad}}\npoints: [{{positions: [0.0, 1.0]}}]\n")
    with pytest.raises(TeachError, match=r"wave.yaml.*order another program may have changed.*record the motion"):
        motions.get("wave")


@pytest.mark.parametrize("taught", [POSES, PATH])
def test_a_file_means_the_same_when_another_program_has_sorted_its_keys(motions: TaughtMotions, taught: Taught) -> None:
    motions.save("wave", taught, JOINTS)
    content = yaml.safe_load(motions.path("wave").read_text())
    motions.path("wave").write_text(yaml.safe_dump(content, sort_keys=True))
    back = motions.get("wave").of(NAMES, "wave")
    assert back.joints == NAMES and back.position == pytest.approx(taught.position, abs=1e-5)


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("joints: [wrist, wrist]\nunits: {wrist: rad}", "names a joint twice"),
        ("joints: [wrist]\nunits: {}", "units has no joint"),
        ("joints: [wrist]\nunits: {arm: rad}", "units has arm, and joints has wrist"),
    ],
)
def test_each_joint_has_one_name_and_one_unit(motions: TaughtMotions, head: str, said: str) -> None:
    motions.path("wave").write_text(f"version: 2\n{head}\npoints: [{{positions: [0.0]}}]\n")
    with pytest.raises(TeachError, match=said):
        motions.get("wave")


def test_another_unit_than_the_arms_is_refused(motions: TaughtMotions) -> None:
    motions.save("wave", POSES, JOINTS)
    motions.get("wave").check_units(SO101.robot.joints, "wave")
    text = motions.path("wave").read_text()
    motions.path("wave").write_text(text.replace("gripper: rad", "gripper: m"))
    with pytest.raises(TeachError, match="gripper is in m, and the arm's is in rad"):
        motions.get("wave").check_units(SO101.robot.joints, "wave")


def test_joints_are_brought_into_the_arms_order_and_others_are_refused_by_name() -> None:
    turned = PATH.of(NAMES[::-1], "wave")
    assert turned.path is not None and turned.position[1, -1] == turned.path.position[1, -1] == pytest.approx(0.123456)
    with pytest.raises(TeachError, match=r"wave is of another arm: it has no wrist; the arm has no gripper\."):
        PATH.of([*NAMES[:-1], "wrist"], "wave")


def test_positions_beyond_the_limits_are_refused_with_each_joint() -> None:
    POSES.check(LIMITS, "wave")
    far = POSITION.copy()
    far[0, 0], far[1, 2] = -3.0, 2.5
    with pytest.raises(TeachError, match=r"wave: shoulder_pan would go to -3.0000.*; elbow_flex would go to 2.5000"):
        Taught(NAMES, far).check(LIMITS, "wave")
    (first, second) = beyond(far, NAMES, LIMITS)
    assert first.startswith("shoulder_pan went 1.080 beyond") and second.startswith("elbow_flex went 0.8")


def path_through(times_s: list[float], pan: list[float], velocity: list[float]) -> Taught:
    """A path of the first joint; the others stand."""
    position, slopes = np.tile(POSITION[0], (len(pan), 1)), np.zeros((len(pan), 6))
    position[:, 0], slopes[:, 0] = pan, velocity
    return Taught(NAMES, position, HandPath(np.array(times_s), position, slopes))


JUMPS = [
    (
        path_through([0.0, 1.0, 1.02, 2.0], [0.0, 0.3, 1.2, 1.5], [0.0] * 4),
        r"shoulder_pan jumps by \+0.9000 rad .* 1 and 2",
    ),
    (path_through([0.0, 0.00001, 2.0], [0.0, 0.01, 0.5], [0.0] * 3), r"jumps by \+0.0100 rad in 0.0000 s .* 0 and 1"),
    (path_through([0.0, 1.0, 2.0], [0.0, 0.1, 0.2], [0.0, -35.0, 0.0]), r"between points 0 and 1 \(35 rad/s\)"),
    (path_through([0.0, 2.0, 4.0], [1.5, 1.5, 1.5], [0.0, 8.0, 0.0]), "shoulder_pan would swing .* beyond its limits"),
]


@pytest.mark.parametrize(("taught", "said"), JUMPS)
def test_what_no_hand_has_shown_is_refused_with_its_joint_and_place(taught: Taught, said: str) -> None:
    with pytest.raises(TeachError, match=f"wave: .*{said}"):
        taught.check(LIMITS, "wave")


def test_mistakes_of_a_file_are_named_with_the_lines_of_their_points(motions: TaughtMotions) -> None:
    """The points begin in line 5. A point of a path has three lines, and a pose has one."""
    far = POSITION.copy()
    far[1, 0] = 4.0
    for taught, said in (
        (JUMPS[0][0], r"between points 1 \(line 8\) and 2 \(line 11\)"),
        (JUMPS[3][0], r"between points 1 \(line 8\) and 2 \(line 11\), whose velocities do not fit"),
        (Taught(NAMES, far), r"shoulder_pan would go to 4.0000 at point 1 \(line 6\)"),
    ):
        motions.save("wave", taught, JOINTS)
        with pytest.raises(TeachError, match=rf"wave.yaml: .*{said}"):
            motions.get("wave").check(LIMITS, str(motions.path("wave")))
    text = motions.path("wave").read_text()
    motions.path("wave").write_text(text.replace("gripper: rad", "gripper: m"))
    with pytest.raises(TeachError, match=r"gripper is in m, and the arm's is in rad \(line 3\)"):
        motions.get("wave").check_units(SO101.robot.joints, "wave")


def test_a_motion_longer_than_a_goal_may_be_is_refused_when_it_is_read_or_made() -> None:
    check_duration(3600.0, "wave")
    with pytest.raises(TeachError, match=r"wave would take 3700 s, .* 3600 s: play it faster, or record it in parts"):
        check_duration(3700.0, "wave")


def test_a_fast_hand_is_not_refused() -> None:
    path_through([0.0, 0.1, 0.2], [0.0, 0.6, 1.2], [0.0, 9.0, 0.0]).check(LIMITS, "wave")


def test_a_folder_that_cannot_be_written_is_told_before_anything_moves(tmp_path: Path) -> None:
    (tmp_path / "taught").write_text("in the way")
    with pytest.raises(DriverError, match="cannot write into"):
        TaughtMotions(tmp_path).require_writable()


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """An arm of one's own, with a motion."""
    (tmp_path / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'so101'}\n")
    motions = TaughtMotions(tmp_path)
    motions.require_writable()
    motions.save("wave", PATH, JOINTS)
    return tmp_path


def test_the_verbs_list_and_forget(arm: Path) -> None:
    run = CliRunner().invoke
    assert run(app, ["teach", "list", "--arm", str(arm)]).output == "wave: a path of 1.5 s through 2 points\n"
    (found,) = json.loads(run(app, ["teach", "list", "--arm", str(arm), "--json"]).output).values()
    assert found == {"kind": "path", "joints": list(NAMES), "points": 2, "duration_s": 1.5}
    assert run(app, ["teach", "remove", "wave", "--arm", str(arm)]).exit_code == 0
    assert run(app, ["teach", "list", "--arm", str(arm)]).output == ""


def test_play_refuses_before_it_opens_a_port(arm: Path) -> None:
    def refused(*words: str) -> str:
        with pytest.raises(DriverError) as error:
            CliRunner().invoke(app, ["teach", "play", *words, "--port", "./no_such_port"], catch_exceptions=False)
        return str(error.value)

    motions = TaughtMotions(arm)
    motions.save("jump", JUMPS[0][0], JOINTS)
    assert "shoulder_pan jumps by" in refused("jump", "--arm", str(arm), "--hands-free")
    motions.save("metres", POSES, JOINTS)
    motions.path("metres").write_text(motions.path("metres").read_text().replace("gripper: rad", "gripper: m"))
    assert "gripper is in m" in refused("metres", "--arm", str(arm), "--hands-free")
    assert "no key can be held because stdin is not a terminal" in refused("wave", "--arm", str(arm))
    for unattended in ("--hands-free", "--yes"):
        assert "nothing was taught as nod" in refused("nod", "--arm", str(arm), unattended)
    assert "no_such_port" in refused("wave", "--arm", str(arm), "--hands-free")


def test_recording_anew_is_asked_and_a_bad_name_is_told_at_once(arm: Path) -> None:
    run = CliRunner().invoke
    words = ["teach", "record", "wave", "--arm", str(arm), "--port", "./no_such_port"]
    asked = run(app, words, input="n\n")
    assert asked.exit_code == 1 and "The motion wave exists already. Replace it?" in asked.output
    with pytest.raises(TeachError, match="is no name"):
        run(app, ["teach", "record", "a b", *words[3:]], catch_exceptions=False)
