"""Make small changes in important code, one at a time, and list the changes that no test detects.

make mutants                       # all areas below
make mutants AREAS="gate joint"    # only these areas

docs/testing.md explains what to do with a surviving mutant, and lists the known ones.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "build" / "mutants"
TREE = FOLDER / "tree"
"""Copy of the tracked files, because the tool writes its mutants next to the code."""
TOOL = FOLDER / "mutmut"
"""Folder of the tool, separate from .venv, so that the setup does not have to install mutmut and its eight
dependencies."""
VERSION = "3.8.1"
MUTMUT = (sys.executable, "-m", "mutmut")
LOG = FOLDER / "log"
LIMIT_S = 1800.0
"""Time limit for one area, in seconds. Mutants that have not been tested within this time are reported."""


@dataclass(frozen=True)
class Area:
    """Files to change, and the tests that must detect the changes. Both may be patterns."""

    files: tuple[str, ...]
    tests: tuple[str, ...]


AREAS = {
    "gate": Area(("hal/gate.py",), ("tests/hal/test_gate.py",)),
    "joint": Area(("hal/joint.py",), ("tests/hal/test_joint.py",)),
    "servo_hardware": Area(
        (
            "hal/servos/servo_hardware.py",
            "hal/servos/servo_setup.py",
            "hal/servos/servo_states.py",
            "hal/servos/activation.py",
        ),
        (
            "tests/hal/test_servo_*.py",
            "tests/hal/test_activation_*.py",
            "tests/hal/test_read_deadline.py",
            "tests/hal/test_hardware_contract.py",
            "tests/hal/test_joint_buses.py",
            "tests/hal/test_own_limits.py",
            "tests/hal/test_setup_on_bad_lines.py",
            "tests/hal/test_dynamixel_*.py",
            "tests/hal/test_plausibility.py",
            "tests/hal/test_outputs.py",
            "tests/hal/test_torque_watch.py",
            "tests/hal/test_supply.py",
        ),
    ),
    "loop": Area(
        (
            "controller/loop.py",
            "controller/loop_figures.py",
            "controller/manager/cycle.py",
            "hal/fault_timeout.py",
        ),
        (
            "tests/controller/test_loop.py",
            "tests/controller/test_component_transitions.py",
            "tests/hal/test_fault_timeout.py",
            "tests/controller/test_manager.py",
            "tests/controller/test_manager_stops.py",
            "tests/controller/test_relief.py",
            "tests/controller/test_start_outside.py",
            "tests/controller/test_false_measurements.py",
        ),
    ),
    "wire": Area(
        ("drivers/protocol/*.py",),
        (
            "tests/drivers/test_decoder.py",
            "tests/drivers/test_*wire.py",
            "tests/drivers/test_*_sdk_parity.py",
            "tests/drivers/test_dynamixel_parity.py",
            "tests/drivers/test_dynamixel_fast.py",
        ),
    ),
    "late_replies": Area(("drivers/bus/late_replies.py",), ("tests/drivers/test_late_replies*.py",)),
}


def main() -> int:
    names = sys.argv[1:] or list(AREAS)
    if unknown := [name for name in names if name not in AREAS]:
        print(f"make mutants: unknown area {', '.join(unknown)}: choose from {', '.join(AREAS)}", file=sys.stderr)
        return 2
    install_tool()
    return max([attempt(name, AREAS[name]) for name in names])


def install_tool() -> None:
    if not (TOOL / f"mutmut-{VERSION}.dist-info").is_dir():
        shutil.rmtree(TOOL, ignore_errors=True)
        pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
        subprocess.run([*pip, "--target", TOOL, f"mutmut=={VERSION}"], check=True)


def attempt(name: str, area: Area) -> int:
    """Test all mutants of one area, and return 0 if all of them were tested, whether or not they were detected."""
    copy_tree()
    (TREE / "setup.cfg").write_text(settings(area))
    began_s = time.monotonic()
    status = run_mutmut()
    if status is None:
        print(f"{name}: not all mutants were tested within {LIMIT_S:.0f} s")
    elif status:
        print(f"{name}: mutmut failed:\n{LOG.read_text()[-3000:]}")
        return 1
    verdicts = [line.split(": ") for line in told("results", "--all", "true") if ": " in line]
    left = [mutant.strip() for mutant, verdict in verdicts if verdict != "killed"]
    print(f"{name}: {len(verdicts)} mutants, {len(left)} not detected, {time.monotonic() - began_s:.0f} s")
    for mutant, verdict in verdicts:
        if verdict != "killed":
            print(f"\n{mutant.strip()}: {verdict}", *changed_lines(mutant.strip()), sep="\n", flush=True)
    return int(status is None)


def copy_tree() -> None:
    shutil.rmtree(TREE, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (TREE / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, TREE / name)


def settings(area: Area) -> str:
    files = list(found(area.files))
    packages = sorted({file.split("/")[0] for file in files})
    beside = sorted(path.name for path in TREE.iterdir() if path.name not in packages)
    lists = {
        "source_paths": packages,
        "only_mutate": files,
        "also_copy": beside,
        "pytest_add_cli_args_test_selection": list(found(area.tests)),
        "pytest_add_cli_args": ["-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not soak"],
    }
    return "[mutmut]\n" + "".join(f"{key} =\n{lines(values)}" for key, values in lists.items())


def found(patterns: Sequence[str]) -> Iterator[str]:
    for pattern in patterns:
        paths = sorted(TREE.glob(pattern))
        if not paths:
            raise SystemExit(f"make mutants: no file matches {pattern}: correct AREAS in tools/mutants.py")
        yield from (str(path.relative_to(TREE)) for path in paths if path.name != "__init__.py")


def lines(values: Sequence[str]) -> str:
    return "".join(f"    {value}\n" for value in values)


def run_mutmut() -> int | None:
    """Run mutmut with its child processes, and return its exit status, or None if it did not end in time."""
    command = [*MUTMUT, "run", "--max-children", "2"]
    with LOG.open("w") as log:
        process = subprocess.Popen(command, cwd=TREE, env=environment(), stdout=log, stderr=log, start_new_session=True)
    try:
        return process.wait(LIMIT_S)
    except subprocess.TimeoutExpired:
        return None
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def told(*arguments: str) -> list[str]:
    """Return the lines that mutmut prints about the tested mutants."""
    run = subprocess.run([*MUTMUT, *arguments], cwd=TREE, env=environment(), capture_output=True, text=True)
    return run.stdout.splitlines()


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(TOOL)}


def changed_lines(mutant: str) -> list[str]:
    return [line for line in told("show", mutant) if line[:1] in "+-" and line[:3] not in ("+++", "---")]


if __name__ == "__main__":
    sys.exit(main())
