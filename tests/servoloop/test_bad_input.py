"""Errors on the command line and in files: each message tells the user what to do."""

import errno
import io
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from shutil import copytree

import pytest

from drivers.port.serial_port import SerialPort
from servoloop import cli
from servoloop.cli import app
from servoloop.commands.output.calibrate_terminal import Terminal
from servoloop.commands.shared.console import confirm, text_console
from servoloop.commands.up import write_ready
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.processes import Interrupted
from servoloop.stack.shipped_files import CONFIG, CONTROLLERS, URDF
from servoloop.stack.signals import Signals
from sim_backend.scene.world_feed import feed_path
from tests.complaint import complaint

TWO_BUSES = str(CONFIG / "robot_arm_two_buses.yaml")


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Path]:
    """Serve a pseudo-terminal without servos."""
    master, slave = os.openpty()
    link = tmp_path / "line"
    link.symlink_to(os.ttyname(slave))
    os.close(slave)
    yield link
    os.close(master)


@pytest.fixture(autouse=True)
def ordinary_priority() -> Iterator[None]:
    """Restore the ordinary priority after a command that failed with real-time priority."""
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def edited(folder: Path, original: Path, old: str, new: str) -> str:
    text = original.read_text()
    assert old in text
    path = folder / original.name
    path.write_text(text.replace(old, new))
    return str(path)


@pytest.mark.parametrize(
    ("option", "original", "old", "new", "says"),
    [
        ("--controllers", CONTROLLERS, "joint6]", "joint9]", "arm_controller.joints names joint9"),
        ("--controllers", CONTROLLERS, "ForwardCommandController", "Nonsense", "unknown type"),
        ("--controllers", CONTROLLERS, "update_rate: 20", "update_rate: 0", "update_rate"),
        ("--controllers", CONTROLLERS, "[hand_right_joint]", "[joint6, joint6]", "names joint6 twice"),
        ("--urdf", URDF, "ros2_control", "other", "has no <ros2_control> block: add a block"),
        ("--urdf", URDF, "servoloop/ServoHardware", "acme/Hardware", "unknown <plugin> acme/Hardware"),
        ("--robot", CONFIG / "robot_arm.yaml", "servo_id: 2", "servo_id: 1", "both have servo_id 1"),
        (
            "--robot",
            CONFIG / "robot_arm.yaml",
            "model: sts3215, sign: -1",
            "model: sts, sign: 2",
            "robot_arm.yaml:11: joints.joint2.model",
        ),
    ],
)
def test_an_error_in_a_file_is_reported_with_its_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    option: str,
    original: Path,
    old: str,
    new: str,
    says: str,
) -> None:
    path = edited(tmp_path, original, old, new)
    assert says in complaint(capsys, monkeypatch, "up", option, path, "--port", str(tmp_path / "none"))


def test_a_missing_file_is_named(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert "cannot read the URDF nowhere.urdf" in complaint(capsys, monkeypatch, "up", "--urdf", "nowhere.urdf")


@pytest.mark.parametrize("name", ["ttyACM77", "n" * 250, "n" * 256])
def test_a_missing_port_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    assert f"/dev/{name} does not exist" in complaint(capsys, monkeypatch, "up", "--port", f"/dev/{name}")


def test_commands_run_in_a_folder_without_permission(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse_access(path: Path) -> bool:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "exists", refuse_access)
    assert "there is no arm so102" in complaint(capsys, monkeypatch, "arms", "show", "so102")


def test_each_of_several_buses_needs_a_port(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = str(CONFIG / "robot_arm_two_buses.yaml")
    words = complaint(capsys, monkeypatch, "up", "--robot", robot, "--port", "arm=/dev/ttyACM77")
    assert "bus hand has no --port. The robot file has the buses arm, hand: use --port arm=PATH --port hand=" in words


@pytest.mark.slow
def test_a_port_without_servos_is_distinguished_from_a_missing_port(
    line: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "no servo responds on" in complaint(capsys, monkeypatch, "up", "--port", str(line))


def test_a_port_in_use_names_its_owner(
    line: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    program = f"import serial; s = serial.Serial({str(line)!r}, exclusive=True); print('open', flush=True); input()"
    owner = subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert owner.stdout and owner.stdout.readline() == "open\n"
    try:
        words = complaint(capsys, monkeypatch, "up", "--port", str(line))
        assert f"(process {owner.pid}): end that program first" in words
    finally:
        owner.communicate("\n")


def test_an_emulator_refuses_a_path_in_use(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = tmp_path / "bus"
    taken.write_text("mine")
    assert str(taken) in complaint(capsys, monkeypatch, "emulate", str(taken))
    assert taken.read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("up", "--port", ""), "--port needs the path of a device, such as /dev/ttyACM0, not ''"),
        (("up", "--port", "/"), "--port needs the path of a device, such as /dev/ttyACM0, not '/'"),
        (
            ("up", "--hardware", "mock", "--port", "/dev/ttyACM77"),
            "--port was given, but no component uses servos: omit --port",
        ),
        (("up", "--hardware", "mujoco", "--port", "/dev/ttyACM77"), "omit --port or --hardware"),
        (("up", "--hardware", "mock", "--ready-file", "/nix/nix"), "cannot write into /nix: No such file"),
        (("up", "--hardware", "mock", "--ready-file", "/"), "/ is a folder: choose the name of a file"),
        (
            ("up", "--rtf", "5", "--port", "/dev/ttyACM77"),
            "real servos cannot run in simulated time: omit --port, or --rtf",
        ),
        (("up", "--step", "--port", "/dev/ttyACM77"), "real servos cannot run in simulated time: omit --port"),
        (("up", "--hardware", "mock", "--no-ros", "--network"), "--network opens ROS 2 to the network, but --no-ros"),
        (("up", "--rtf", "0"), "--rtf must be max or a factor above 0, such as 0.5 or 5, not '0'"),
        (("emulate", ""), "LINK must be an unused path such as ./bus, not '.'"),
        (("emulate", "/no/dir/x"), "cannot serve at /no/dir/x.world: No such file"),
        (("emulate", "bus", "--pictures", "/proc/x"), "cannot write into /proc/x: No such file"),
        (("setup", "--bus", "hand"), "the robot file has only one bus, which is not named hand; omit --bus"),
        (("passport", "save", "x", "--arm", "so101", "--bus", "hand"), "which is not named hand; omit --bus"),
        (("setup", "--robot", TWO_BUSES, "--bus", "leg"), "several buses; choose one with --bus arm or hand"),
        (("passport", "save", "x", "--robot", TWO_BUSES), "several buses; choose one with --bus arm or hand"),
        (("bench", "arm", "--out", "/proc"), "/proc is a folder: choose the name of a file"),
        (("doctor", "--report", "/"), "/ is a folder: choose the name of a file"),
        (("doctor", "--report", "/dev/null"), "/dev/null is not a regular file"),
        (("demo", "--grades", ""), "--grades needs grades such as A,B,C, not ''"),
        (("demo", "--grades", " ,"), "--grades needs grades such as A,B,C, not ' ,'"),
        (("demo", "--grades", "A, Z,b,yy"), "--grades: there is no bin for Z, yy;"),
        (("demo", "--grades", "Z"), "vision_pick_place_controller.yaml has bins for A, B, C"),
        (("pick", " "), "GRADE must not be empty; choose a grade, such as A"),
        (("demo", "--out", "/proc/nix"), "cannot write into /proc/nix: No such file"),
    ],
    ids=lambda a: " ".join(a) if isinstance(a, tuple) else "",
)
def test_invalid_arguments_are_reported_before_torque_is_enabled(
    arguments: tuple[str, ...],
    says: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if arguments[0] == "demo":
        pytest.importorskip("rclpy")
    monkeypatch.chdir(tmp_path)
    assert says in complaint(capsys, monkeypatch, *arguments)
    assert not any(tmp_path.iterdir())


def test_files_left_by_a_killed_emulator_are_not_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    link = tmp_path / "bus"
    link.symlink_to("/dev/pts/none")
    with socket.socket(socket.AF_UNIX) as feed:
        feed.bind(str(feed_path(link)))
    assert f"{link} does not exist" in complaint(capsys, monkeypatch, "up", "--port", str(link))


@pytest.mark.parametrize(
    "words",
    [
        ("teach", "record", "wave", "--arm", "./mine"),
        ("teach", "record", "wave", "--arm", "./mine", "--limp"),
        ("tune", "gripper", "--arm", "./mine"),
        ("bench", "arm", "--arm", "./mine"),
        ("calibrate", "--arm", "./mine", "--auto"),
    ],
    ids=" ".join,
)
def test_a_busy_port_is_reported_before_the_question(
    line: Path,
    tmp_path: Path,
    words: tuple[str, ...],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    copytree(CONFIG / "arms" / "so101", tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    with closing(SerialPort(str(line))):
        said = complaint(capsys, monkeypatch, *words, "--port", str(line))
    assert "is already open in this program" in said and "Continue?" not in said


@pytest.mark.parametrize("verb", ["up", "demo", "pick", "emulate"])
def test_every_verb_has_help_with_an_example(
    verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["servoloop", verb, "--help"])
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    assert exit_.value.code == 0
    assert f"Example: servoloop {verb}" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("words", [(), ("goto",), ("scene",), ("scene", "add"), ("register", "read")])
def test_the_short_help_option_prints_the_help(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["servoloop", *words, "-h"])
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    assert exit_.value.code == 0
    out = capsys.readouterr().out
    assert "Show this message and exit." in out and " ".join(words) in out


def test_the_help_shows_that_angles_are_separate_arguments(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["servoloop", "goto", "--help"])
    with pytest.raises(SystemExit):
        cli.main()
    out = capsys.readouterr().out
    assert "ROLL PITCH YAW" in out and "<float,float,float>" not in out


def test_a_ready_file_that_cannot_be_written_is_logged_and_leaves_no_partial_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The stack keeps running."""

    def no_room(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    write_ready(tmp_path / "ready")
    assert (tmp_path / "ready").read_text() == f"{os.getpid()}\n"
    monkeypatch.setattr(Path, "replace", no_room)
    write_ready(tmp_path / "again")
    assert f"cannot write {tmp_path / 'again'}: No space left on device" in caplog.text
    assert [path.name for path in tmp_path.iterdir()] == ["ready"]


def test_an_error_in_the_defaults_of_a_robot_file_is_reported_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = edited(tmp_path, CONFIG / "robot_arm.yaml", "interpolation_method: ruckig", "interpolation_method: true")
    said = complaint(capsys, monkeypatch, "up", "--robot", path, "--port", str(tmp_path / "none"))
    line = next(n for n, text in enumerate(Path(path).read_text().splitlines(), 1) if "interpolation_method" in text)
    assert f"{path}:{line}: arm_controller.interpolation_method: must be" in said


@pytest.mark.parametrize(
    ("arguments", "text", "says"),
    [
        (("campaign", "--schedule"), "arm: nobody", ":1: there is no arm nobody"),
        (("campaign", "--scenario"), "faults: 1\narm: nobody", ":2: there is no arm nobody"),
        (("campaign", "--scenario"), "kinds: [silence]", ":1: kinds: unknown fault silence: choose from silent"),
        (("campaign", "--scenario"), "faults: 1000000000", ":1: faults: must be 0 to 10000 in each run, not 1e+09"),
        (
            ("campaign", "--schedule"),
            "faults:\n- {kind: silent, servo_id: 3}\n- {kind: silent, servo_id: 99}",
            ":3: silent at 0 s: there is no servo 99",
        ),
        (("simulate", "--faults"), "[{kind: silent, servo_id: 99}]", ":1: silent at 0 s: there is no servo 99"),
        (("emulate", "bus", "--faults"), "[{kind: silent, servo_id: 99}]", ":1: silent at 0 s: there is no servo 99"),
    ],
)
def test_an_error_in_a_fault_file_is_reported_with_its_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    text: str,
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(text)
    assert f"mine.yaml{says}" in complaint(capsys, monkeypatch, *arguments, "mine.yaml")


def test_a_simulation_without_a_trajectory_controller_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "mine"
    copytree(find_arm("so101").folder, folder)
    (folder / "controllers.yaml").write_text("controller_manager: {ros__parameters: {update_rate: 20}}")
    said = complaint(capsys, monkeypatch, "simulate", "--arm", f"{folder}/", "--seconds", "0")
    assert "controllers.yaml:1: simulated motions require a joint_trajectory_controller/" in said


LONG = "a" * 300


@pytest.mark.parametrize(
    "arguments",
    [
        ("doctor", "--report", f"{LONG}.md"),
        ("simulate", "--record", f"{LONG}.mcap"),
        ("camera", "board", f"{LONG}.pdf"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_name_that_is_too_long_is_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    said = complaint(capsys, monkeypatch, *arguments)
    assert said.startswith("servoloop: cannot ") and "File name too long; choose another path" in said


def test_a_path_without_permission_is_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def denied(path: Path) -> bool:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_dir", denied)
    said = complaint(capsys, monkeypatch, "doctor", "--report", "mine.md")
    assert said == "servoloop: cannot use mine.md: Permission denied; choose another path\n"


def test_text_that_cannot_be_encoded_is_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli, "app", lambda: "grade \udcff".encode())
    said = complaint(capsys, monkeypatch)
    assert said == "servoloop: 'grade \\udcff' contains characters that cannot be encoded: use UTF-8\n"


def test_of_a_long_text_that_cannot_be_encoded_only_the_wrong_part_is_printed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli, "app", lambda: f"<p>\n{'a' * 5000}\nx\udcff.mcap\n{'b' * 5000}".encode())
    said = complaint(capsys, monkeypatch)
    assert "a\\nx\\udcff.mcap\\nb" in said and len(said) < 200 and said.count("\n") == 1


def test_characters_that_stdout_cannot_encode_are_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    output = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(output, "utf-8"))
    monkeypatch.setattr(cli, "app", lambda: text_console().print("/dev/\udcff"))
    cli.main()
    assert output.getvalue() == b"/dev/\\udcff\n"


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (app, "stdin is not a terminal"),
        (lambda: confirm("Continue?", yes=False), "the question was not answered, and nothing was done"),
        (lambda: Terminal(Signals(), yes=False).confirm("Continue?"), "the input has ended"),
    ],
    ids=["jog", "question", "dialog"],
)
def test_a_closed_stdin_is_reported_like_an_empty_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, command: Callable[[], None], says: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["servoloop", "jog"])
    monkeypatch.setattr(sys, "stdin", None)
    monkeypatch.setattr(cli, "app", command)
    with pytest.raises(SystemExit):
        cli.main()
    assert sys.stdin is not None
    sys.stdin.close()
    assert says in capsys.readouterr().err


def test_the_notes_of_an_interruption_are_printed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted = Interrupted("interrupted; nothing was stored")
    interrupted.add_note("torque may still be on: servo 2")

    def app() -> None:
        raise interrupted

    monkeypatch.setattr(cli, "app", app)
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    assert exit_.value.code == cli.INTERRUPTED
    assert capsys.readouterr().err == "servoloop: interrupted; nothing was stored\ntorque may still be on: servo 2\n"
