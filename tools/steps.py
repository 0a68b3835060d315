"""Steps of the setup with their progress: environment, packages, this project, message packages."""

import os
import re
import shutil
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from importlib.machinery import PathFinder
from pathlib import Path

from commands import Commands, ToolError
from interface_packages import needed_packages
from places import HOOKS, INTERFACES, LOCK, LOGS, MOVEIT_PY, PYTHON, ROOT, ROS2_CLI, SITE_PACKAGES, STAMPS, VENV
from plain_path import plain_root
from progress import SetUpStep
from requirements import outdated
from stamps import (
    digest,
    interface_key,
    locked_packages,
    moveit_py_key,
    project_key,
    ros2_cli_key,
    simulation_key,
    stamp,
    venv_key,
)

CORES = len(os.sched_getaffinity(0))
PIP = (PYTHON, "-m", "pip", "--disable-pip-version-check", "--no-input", "install", "--progress-bar=off")
UV = (VENV / "bin" / "uv", "pip", "install", "--python", PYTHON, "--no-deps", "--no-build-isolation")


def make_venv(step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands) -> None:
    command = (sys.executable, "-m", "venv", "--clear", VENV)
    step.follow([pool.submit(commands.run, "venv", *command)], lambda: f".venv with Python {sys.version.split()[0]}")
    stamp("venv", venv_key())


def check_lock() -> None:
    """Raise ToolError if requirements.lock is older than the requirements in pyproject.toml."""
    try:
        if sentence := outdated((ROOT / "pyproject.toml").read_text(), locked_packages()):
            raise ToolError(sentence)
    except ValueError as error:
        raise ToolError(f"{error}.") from None


def install_packages(step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands) -> None:
    check_lock()
    detail = ["uv"]

    def on_line(line: str) -> None:
        if words := re.match(r"\s*(Downloading|Building) (\S+)|(Prepared|Installed) \d+ packages", line):
            detail[0] = words.group(0).strip().lower()

    # pip installs uv and setuptools, with which uv builds the two source packages. The lock file contains the hashes of
    # all packages, so versions do not have to be resolved. Python compiles modules when they are imported.
    first = LOGS / "first.lock"
    first.write_text("".join(re.findall(r"^(?:uv|setuptools)==.*\n(?: .*\n)*", LOCK.read_text(), re.MULTILINE)))

    def run() -> None:
        commands.run("packages", *PIP, "--no-compile", "--no-deps", "--require-hashes", "-r", first)
        commands.run("packages", *UV, "--require-hashes", "-r", LOCK, on_line=on_line)

    # If uv is killed while it unpacks, it may leave an incomplete package that it cannot repair. In that case, .venv is
    # created again.
    stamp("installing", "")
    try:
        step.follow([pool.submit(run)], lambda: detail[0])
    except ToolError:
        (STAMPS / "installing").unlink()  # uv itself has failed and removed its incomplete files
        raise
    (STAMPS / "installing").unlink()
    stamp("packages", digest(LOCK))


def install_project(step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands) -> None:
    command = (*UV, "--editable", ROOT)
    step.follow([pool.submit(commands.run, "project", *command)], lambda: "servoloop itself, editable")
    stamp("project", project_key())


def is_moveit_present() -> bool:
    """Return whether Python finds a real MoveIt, whose package ``moveit`` must not be replaced."""
    paths = [str(SITE_PACKAGES), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    return PathFinder.find_spec("moveit", paths) is not None


def install_moveit_py(step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands) -> None:
    command = (*UV, "--editable", MOVEIT_PY)
    step.follow([pool.submit(commands.run, "moveit_py", *command)], lambda: "MoveIt's Python interface, editable")
    stamp("moveit_py", moveit_py_key())


def is_ros2_present() -> bool:
    """Return whether the shell finds the command of a ROS installation, which must not be replaced."""
    found = shutil.which("ros2")
    return found is not None and not Path(found).is_relative_to(VENV)


def install_ros2_cli(step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands) -> None:
    command = (*UV, "--editable", ROS2_CLI)
    step.follow([pool.submit(commands.run, "ros2_cli", *command)], lambda: "the command ros2, editable")
    stamp("ros2_cli", ros2_cli_key())


def compile_simulation(step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands) -> None:
    """Compile the simulation and the planning code, because otherwise their first use would take up to a minute."""
    parts = {"simulation": "sim_backend.compile_ahead", "planning": "planning.collision"}
    runs = [pool.submit(commands.run, name, PYTHON, "-m", module) for name, module in parts.items()]
    step.follow(runs, lambda: "the simulation and the planning, into machine code")
    stamp("simulation", simulation_key())


def uninstall_interfaces(package: str) -> None:
    """Remove the installed interfaces, because files that a package no longer contains must not remain importable."""
    manifest = STAMPS / f"{package}.files"
    for line in manifest.read_text().splitlines() if manifest.exists() else []:
        Path(line).unlink(missing_ok=True)
    # Also remove the files that Python has compiled in this folder.
    shutil.rmtree(SITE_PACKAGES / package, ignore_errors=True)
    (STAMPS / f"interfaces-{package}").unlink(missing_ok=True)
    manifest.unlink(missing_ok=True)


def build_interfaces(stale: list[str], step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands) -> None:
    with plain_root() as root:
        _build_interfaces(stale, root, step, pool, commands)


def _build_interfaces(
    stale: list[str], root: Path, step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands
) -> None:
    """Build the message packages. ``root`` is a path of the checkout that CMake can read."""
    state = dict.fromkeys(stale, "")
    venv = root / VENV.relative_to(ROOT)
    prefixes = {"AMENT_PREFIX_PATH": str(venv), "CMAKE_PREFIX_PATH": str(venv)}
    futures: dict[str, Future[None]] = {}

    def build(package: str) -> None:
        for needed in needed_packages(package).intersection(stale):
            futures[needed].result()

        def on_line(line: str) -> None:
            if count := re.match(r"\[(\d+/\d+)\]", line):
                state[package] = count.group(1)

        log = f"interfaces-{package}"
        folder = root / "build" / "interfaces" / package
        cmake = venv / "bin" / "cmake"
        options = {
            "CMAKE_INSTALL_PREFIX": VENV,
            "CMAKE_PROJECT_INCLUDE": root / HOOKS.relative_to(ROOT),
            "Python3_EXECUTABLE": venv / PYTHON.relative_to(VENV),
            "BUILD_TESTING": "OFF",
        }
        state[package] = "configuring"
        defined = [f"-D{name}={value}" for name, value in options.items()]
        source = root / INTERFACES.relative_to(ROOT) / package
        run = partial(commands.run, log, cmake, variables=prefixes)
        run("--fresh", "-G", "Ninja", "-S", source, "-B", folder, *defined)
        run("--build", folder, "--parallel", str(CORES), on_line=on_line)
        uninstall_interfaces(package)
        run("--install", folder)
        shutil.copy(folder / "install_manifest.txt", STAMPS / f"{package}.files")
        stamp(f"interfaces-{package}", interface_key(package))
        state[package] = "done"

    for package in stale:  # A package follows the packages that it needs, so a waiting build never blocks them.
        futures[package] = pool.submit(build, package)
    step.follow(
        list(futures.values()),
        lambda: ", ".join(f"{name} {text}" for name, text in state.items() if text not in ("", "done")),
    )
