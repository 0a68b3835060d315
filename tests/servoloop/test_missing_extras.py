"""Every command works in the base installation, or names the extra that it needs."""

import json
import shlex
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import pytest
from typer.main import get_command

from servoloop.cli import app
from servoloop.extras import LIBRARIES
from tests.servoloop.without import EXTRAS

ROOT = Path(__file__).parents[2]
LIMIT_S = 100.0
PORT = "/dev/ttyACM77"
"""Serial port that does not exist on any machine."""
ARM = ROOT / "config" / "arms" / "so101"


class Line(NamedTuple):
    """Command lines, and the extras that each of them needs in addition to the base installation."""

    line: str
    needs: tuple[str, ...] = ()


LINES: Final = (
    Line(f"up --port {PORT}"),
    Line("up", ("sim",)),
    Line("up --hardware mujoco", ("sim",)),
    Line("up --rtf 5", ("sim",)),
    Line("up --urdf missing.xacro", ("xacro",)),
    Line("pick A", ("ros",)),
    Line("plan-server", ("planning", "ros")),
    Line(f"topic-host --port {PORT}", ("ros",)),
    Line("goto 0.2 -0.1 0.2", ("planning", "ros")),
    Line("scene list", ("planning", "ros")),
    Line("scene add shelf box 0.1 0.1 0.1 --at 0.3 0 0.1", ("planning", "ros")),
    Line("scene remove shelf", ("planning", "ros")),
    Line("scene load bench.yaml", ("planning",)),
    Line("demo --arm missing", ("sim",)),
    Line("view missing.mcap --no-browser", ("view",)),
    Line("monitor missing.mcap", ("monitor",)),
    Line("record run.mcap"),
    Line("plot missing.mcap", ("report",)),
    Line("jog"),
    Line("stop"),
    Line("register tables"),
    Line(f"teleop {PORT} {PORT}8"),
    Line("replay missing.mcap", ("view",)),
    Line(f"replay missing.mcap --port {PORT}"),
    Line("ports"),
    Line(f"scan {PORT}"),
    Line("scan"),
    Line(f"setup --port {PORT}"),
    Line(f"calibrate --arm so101 --port {PORT}"),
    Line(f"doctor --port {PORT}"),
    Line("doctor --port virtual", ("sim",)),
    Line(f"tune joint1 --port {PORT} --yes"),
    Line("tune joint1 --port virtual --yes", ("sim",)),
    Line(f"set-id 1 2 --port {PORT}"),
    Line(f"set-baud 1 1000000 --port {PORT}"),
    Line(f"factory-reset 1 --port {PORT} --yes"),
    Line(f"reboot 1 --port {PORT}"),
    Line("emulate bus --faults missing.yaml", ("sim",)),
    Line("emulate bus --view --faults missing.yaml", ("sim", "view")),
    Line("hand bus joint1 0.1"),
    Line("fault bus"),
    Line("fault --list", ("sim",)),
    Line("simulate --faults missing.yaml", ("sim",)),
    Line("campaign --scenario missing.yaml", ("sim",)),
    Line("campaign --schedule missing.yaml", ("sim",)),
    Line("campaign --scenario short.yaml --ray local", ("sim", "ray")),
    Line("arms"),
    Line("arms new mine robot.urdf"),
    Line("arms combine left=so101 right=so101 --out two"),
    Line("arms check so101"),
    Line("arms show so101", ("sim", "view")),
    Line("arms moveit so101 moveit", ("sim",)),
    Line(f"bench bus --port {PORT}"),
    Line(f"bench arm --port {PORT} --yes", ("report",)),
    Line("calibration import missing.json"),
    Line("calibration export out.json"),
    Line("calibration show"),
    Line("camera list"),
    Line("camera show 77", ("vision",)),
    Line("camera board board.pdf", ("vision",)),
    Line("camera calibrate 77", ("vision",)),
    Line("camera plane 77 --x 0.1 --y 0.1", ("vision",)),
    Line(f"passport save now.yaml --port {PORT}"),
    Line(f"passport diff now.yaml --port {PORT}"),
    Line(f"passport restore now.yaml --port {PORT}"),
    Line("pose save home"),
    Line("pose go home"),
    Line("pose list"),
    Line("pose remove no_such_pose"),
    Line(f"register list --id 1 --port {PORT}"),
    Line(f"register read present_position --id 1 --port {PORT}"),
    Line(f"register write acceleration 1 --id 1 --port {PORT}"),
    Line(f"teach record wave --port {PORT}"),
    Line(f"teach play no_such_motion --port {PORT} --hands-free"),
    Line("teach list"),
    Line("teach remove no_such_motion"),
)
"""Each of these commands exits on its own, even if no arm is connected. A command that needs an extra is refused before
it reads the rest of its command line."""
OPTIONAL: Final = {
    "arms check so101": "sim",
    "arms new mine robot.urdf": "sim",
    "arms combine left=so101 right=so101 --out two": "sim",
}
"""Commands, each with an extra. Without the extra, the command omits a part of its work and reports the omission."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with the files of the command lines, in which no running stack of this machine is found."""
    shutil.copy(ARM / "arm.urdf", tmp_path / "robot.urdf")
    (tmp_path / "short.yaml").write_text("{seconds: 0.5}")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return tmp_path


def run(folder: Path, extras: Sequence[str], lines: Sequence[Line]) -> list[str]:
    """Run the command lines without the extras, and return their outputs. Each command must end without a traceback."""
    command = [sys.executable, "-m", "tests.servoloop.without", ",".join(extras)]
    asked = "".join(json.dumps(shlex.split(one.line)) + "\n" for one in lines)
    done = subprocess.run(command, input=asked, stdout=subprocess.PIPE, text=True, cwd=folder, timeout=LIMIT_S)
    assert done.returncode == 0
    answers = [json.loads(answer) for answer in done.stdout.splitlines()]
    for one, (status, printed) in zip(lines, answers, strict=True):
        assert "Traceback" not in printed and status in (0, 1), (one.line, printed)
        assert not one.needs or status == 1, (one.line, printed)
    return [" ".join(printed.split()) for _, printed in answers]


def refusal(extra: str) -> str:
    """Return the end of the sentence that names the extra, if it is known."""
    return "ROS 2 Jazzy is required" if extra == "ros" else "pip install"


def names(extra: str, printed: str) -> bool:
    """Return whether one sentence names the extra and the command that installs it."""
    listed = printed.rpartition("[")[2].partition("]")[0].split(",")
    return refusal(extra) in printed and (extra == "ros" or extra in listed)


def test_the_table_has_every_command() -> None:
    paths = commands()
    known = {tuple(one.line.split()[: len(path)]) for one in LINES for path in paths}
    assert {path for path in paths if path not in known} == set()


def commands() -> Iterator[tuple[str, ...]]:
    for name, command in get_command(app).commands.items():  # type: ignore[attr-defined]
        subcommands = getattr(command, "commands", {})
        yield from ((name, sub) for sub in subcommands)
        if not subcommands:
            yield (name,)


def test_the_libraries_are_those_of_the_extras() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    for extra, libraries in LIBRARIES.items():
        required = {line.partition(";")[0].partition(">")[0] for line in extras[extra]}
        assert required == set(libraries.values()), extra


@pytest.mark.slow
def test_the_base_installation_runs_each_command_or_names_the_extra(folder: Path) -> None:
    for one, printed in zip(LINES, run(folder, EXTRAS, LINES), strict=True):
        if one.needs:
            assert any(names(extra, printed) for extra in (*one.needs, "ros")), (one.line, printed)
        elif one.line in OPTIONAL:
            assert names(OPTIONAL[one.line], printed), (one.line, printed)
        else:
            assert "pip install" not in printed, (one.line, printed)


@pytest.mark.slow
@pytest.mark.parametrize("extra", EXTRAS)
def test_a_command_names_the_one_extra_that_is_missing(extra: str, folder: Path) -> None:
    lines = [one for one in LINES if extra in one.needs]
    for one, printed in zip(lines, run(folder, [extra], lines), strict=True):
        assert names(extra, printed), (one.line, printed)


@pytest.mark.slow
def test_a_real_arm_needs_only_the_base_installation_and_ros(folder: Path) -> None:
    """The servos are virtual, but they are in another process, at the other end of a serial port."""
    link = folder / "bus"
    emulate = [sys.executable, "-m", "servoloop", "emulate", str(link), "--arm", "so101"]
    emulator = subprocess.Popen(emulate, cwd=folder, stdout=subprocess.DEVNULL)
    try:
        wait_for(link, emulator)
        served = [
            Line(f"scan {link}"),
            Line(f"doctor --arm so101 --port {link}"),
            Line(f"register read present_position --id 1 --port {link}"),
            Line(f"passport save now.yaml --arm so101 --port {link}"),
            Line(f"bench bus --port {link} --ids 1-6 --cycles 20"),
            Line(f"up --arm so101 --port {link} --ready-file {folder / 'never' / 'ready'}"),
        ]
        scan, doctor, register, _, bench, _ = run(folder, EXTRAS, served)
        assert scan.count("1000000") == 6 and "gripper" in doctor and "present_position" in register and "p99" in bench
        up(folder, link)
    finally:
        emulator.send_signal(signal.SIGINT)
        assert emulator.wait(LIMIT_S) == 0


def up(folder: Path, link: Path) -> None:
    """Start and end the stack with the servos on a port, without any extra except for ROS."""
    ready = folder / "ready"
    without = [sys.executable, "-m", "tests.servoloop.without", ",".join(LIBRARIES)]
    log = folder / "up.log"
    with log.open("w") as output:
        command = [*without, "up", "--arm", "so101", "--port", str(link), "--ready-file", str(ready)]
        stack = subprocess.Popen(command, cwd=folder, stdout=output, stderr=subprocess.STDOUT)
    wait_for(ready, stack)
    stack.send_signal(signal.SIGINT)
    assert stack.wait(LIMIT_S) == 0, log.read_text()


def wait_for(path: Path, process: "subprocess.Popen[bytes]") -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while not path.exists():
        assert process.poll() is None and time.monotonic() < deadline_s, path
        time.sleep(0.05)
