"""Makes .venv: Python packages, this project, and the ROS 2 message packages in interfaces/. Run by `make setup`.

Each step leaves a stamp in .venv that holds a hash of all it was made from, so that a second run does only what is
missing or out of date, and an interrupted run goes on where it stopped. Only the standard library is used here.
"""

import fcntl
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import threading
import time
import tomllib
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from interface_packages import INTERFACES, ROOT, packages
from progress import Step

VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMPS = VENV / "stamps"
LOGS = ROOT / "build" / "setup"
LOCK = ROOT / "requirements.lock"
HOOKS = ROOT / "tools" / "cmake" / "hooks.cmake"
CORES = len(os.sched_getaffinity(0))

# What the shell may bring along that would mix another installation into ours.
FOREIGN = re.compile(r"(AMENT|COLCON|CMAKE|ROS|_ROS|PYTHON|CONDA)_?|LD_LIBRARY_PATH$|PIP_(USER|TARGET|PREFIX)$")


class SetUpError(Exception):
    """Carries what the user should read: what failed, and what to do."""


# --- commands ---------------------------------------------------------------------------------------------------------


def environment() -> dict[str, str]:
    env = {name: value for name, value in os.environ.items() if not FOREIGN.match(name)}
    env["PATH"] = f"{VENV / 'bin'}{os.pathsep}{os.environ['PATH']}"
    env.setdefault("CC", "gcc")
    env.setdefault("CXX", "g++")
    return env | {"PYTHONUNBUFFERED": "1", "AMENT_PREFIX_PATH": str(VENV), "CMAKE_PREFIX_PATH": str(VENV)}


class Commands:
    """Runs commands with their output in log files, and ends them when set-up ends early."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def run(self, log_name: str, *command: str | Path, on_line: Callable[[str], None] = lambda line: None) -> None:
        log_path = LOGS / f"{log_name}.log"
        with log_path.open("a") as log:
            log.write(f"$ {' '.join(map(str, command))}\n")
            log.flush()
            process = self._start(command)
            assert process.stdout is not None
            for line in process.stdout:
                log.write(line)
                on_line(line)
            status = process.wait()
        self._running.discard(process)
        if status != 0:
            raise SetUpError(explain(log_path, command, status))

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            for process in list(self._running):
                process.terminate()

    def _start(self, command: Iterable[str | Path]) -> "subprocess.Popen[str]":
        with self._lock:
            if self._stopped:
                raise SetUpError("stopped")
            process = subprocess.Popen(
                list(map(str, command)),
                cwd=ROOT,
                env=environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
            )
            self._running.add(process)
            return process


HINTS = (
    (r"No space left on device", "The disk is full: .venv and build/ need 1 GB."),
    (r"DO NOT MATCH THE HASHES", "A package differs from the locked one. Do not install it; find out why."),
    (
        r"Temporary failure in name resolution|Connection|Max retries|timed out|CERTIFICATE|ProxyError"
        r"|No matching distribution found",
        "The package registry can not be reached or lacks this: look at the network, the proxy and pip config list.",
    ),
    (r"Python\.h", "This Python has no headers; on Debian or Ubuntu: sudo apt install python3-dev"),
    (r"Killed|cc1plus.*(memory|Terminated)", "The compiler ran out of memory: close something and try again."),
)


def explain(log_path: Path, command: Iterable[str | Path], status: int) -> str:
    text = log_path.read_text(errors="replace")
    tail = "\n".join("    " + line for line in text.splitlines()[-20:])
    hints = [hint for pattern, hint in HINTS if re.search(pattern, text)] or [
        "The reason should be in the lines above."
    ]
    program = " ".join(Path(part).name for part in list(map(str, command))[:3])
    return (
        f"{program} … failed with status {status}; the end of {log_path.relative_to(ROOT)}:\n{tail}\n\n{hints[0]}\n"
        "Then run make setup again: it goes on from here."
    )


def site_packages() -> Path:
    return Path(sysconfig.get_path("purelib", "venv", {"base": str(VENV)}))


# --- stamps -----------------------------------------------------------------------------------------------------------


def digest(*parts: str | Path) -> str:
    """One hash over texts, files, and folders of files."""
    total = hashlib.sha256()
    for part in parts:
        files = [part] if isinstance(part, Path) and part.is_file() else []
        if isinstance(part, Path) and part.is_dir():
            files = sorted(path for path in part.rglob("*") if path.is_file())
        for path in files:
            total.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes() + b"\0")
        if isinstance(part, str):
            total.update(part.encode() + b"\0")
    return total.hexdigest()


def is_stamped(name: str, key: str) -> bool:
    stamp = STAMPS / name
    return stamp.exists() and stamp.read_text() == key


def stamp(name: str, key: str) -> None:
    STAMPS.mkdir(exist_ok=True)
    (STAMPS / name).write_text(key)


def locked_packages() -> dict[str, str]:
    """Name -> version of everything in the lock file."""
    return dict(re.findall(r"^([a-z0-9-]+)==(\S+)", LOCK.read_text(), re.MULTILINE))


def venv_key() -> str:
    # A virtual environment holds absolute paths, its own and that of the Python it was made with.
    return digest(str(VENV), sys.version, os.path.realpath(sys.executable))


def project_key() -> str:
    return digest(ROOT / "pyproject.toml")


def interface_key(package: str) -> str:
    tools = [
        f"{name} {version}" for name, version in locked_packages().items() if re.match("ros-|cmake|empy|numpy", name)
    ]
    return digest(INTERFACES / package, HOOKS, *tools)


# --- steps ------------------------------------------------------------------------------------------------------------


def make_venv(step: Step, pool: ThreadPoolExecutor, commands: Commands) -> None:
    command = (sys.executable, "-m", "venv", "--clear", VENV)
    step.follow([pool.submit(commands.run, "venv", *command)], lambda: f".venv with Python {sys.version.split()[0]}")
    stamp("venv", venv_key())


def check_lock() -> None:
    """A lock file that someone forgot to renew is found here, not by a user."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = project["project"]["dependencies"]
    for group in (*project["project"]["optional-dependencies"].values(), *project["dependency-groups"].values()):
        wanted = wanted + group
    locked = locked_packages()
    for requirement in wanted:
        name, version = re.match(r"([\w.-]+)(?:\[.*?\])?==([^\s;]+)", requirement).groups()
        if locked.get(name.lower()) != version:
            raise SetUpError(f"pyproject.toml wants {name} {version}, requirements.lock does not: run make lock.")


def install_packages(step: Step, pool: ThreadPoolExecutor, commands: Commands) -> None:
    check_lock()
    total = len(locked_packages())
    fetched: list[str] = []

    def on_line(line: str) -> None:
        if line.startswith("Collecting "):
            fetched.append(line.split()[1].split("=")[0])

    def detail() -> str:
        installed = len(list(site_packages().glob("*.dist-info")))
        if installed < 5:
            return f"fetching {len(fetched)}/{total} {fetched[-1] if fetched else ''}"
        return f"installing {min(installed, total)}/{total}"

    # The lock names everything with its hash, so pip has nothing to resolve (--no-deps) and fetches no builders of its
    # own (--no-build-isolation; setuptools comes first, because two packages are source). Python compiles what is
    # really imported, when it is (--no-compile).
    pip = (
        PYTHON,
        "-m",
        "pip",
        "--disable-pip-version-check",
        "--no-input",
        "install",
        "--progress-bar=off",
        "--no-deps",
    )
    builder = LOGS / "setuptools.lock"
    builder.write_text(re.search(r"^setuptools==.*?(?=^[a-z])", LOCK.read_text(), re.MULTILINE | re.DOTALL).group())

    def run() -> None:
        for lock in (builder, LOCK):
            options = ("--no-build-isolation", "--no-compile", "--require-hashes", "-r", lock)
            commands.run("packages", *pip, *options, on_line=on_line)

    # Killed while it unpacks, pip may leave half a package that it can not mend: then .venv is made anew.
    stamp("installing", "")
    try:
        step.follow([pool.submit(run)], detail)
    except SetUpError:
        (STAMPS / "installing").unlink()  # pip itself gave up, and tidied up
        raise
    (STAMPS / "installing").unlink()
    stamp("packages", digest(LOCK))


def install_project(step: Step, pool: ThreadPoolExecutor, commands: Commands) -> None:
    pip = (PYTHON, "-m", "pip", "--disable-pip-version-check", "--no-input", "install", "--no-deps")
    command = (*pip, "--no-build-isolation", "--editable", ROOT)
    step.follow([pool.submit(commands.run, "project", *command)], lambda: "servoloop itself, editable")
    stamp("project", project_key())


def uninstall_interfaces(package: str) -> None:
    """Files that a package no longer has must not stay importable."""
    manifest = STAMPS / f"{package}.files"
    for line in manifest.read_text().splitlines() if manifest.exists() else []:
        Path(line).unlink(missing_ok=True)
    shutil.rmtree(site_packages() / package, ignore_errors=True)  # with what Python compiled there
    (STAMPS / f"interfaces-{package}").unlink(missing_ok=True)
    manifest.unlink(missing_ok=True)


def build_interfaces(stale: list[str], step: Step, pool: ThreadPoolExecutor, commands: Commands) -> None:
    state = dict.fromkeys(stale, "")

    def build(package: str) -> None:
        def on_line(line: str) -> None:
            if count := re.match(r"\[(\d+/\d+)\]", line):
                state[package] = count.group(1)

        log = f"interfaces-{package}"
        folder = ROOT / "build" / "interfaces" / package
        cmake = VENV / "bin" / "cmake"
        options = {
            "CMAKE_INSTALL_PREFIX": VENV,
            "CMAKE_PROJECT_INCLUDE": HOOKS,
            "Python3_EXECUTABLE": PYTHON,
            "BUILD_TESTING": "OFF",
        }
        state[package] = "configuring"
        defined = [f"-D{name}={value}" for name, value in options.items()]
        commands.run(log, cmake, "--fresh", "-G", "Ninja", "-S", INTERFACES / package, "-B", folder, *defined)
        commands.run(log, cmake, "--build", folder, "--parallel", str(CORES), on_line=on_line)
        uninstall_interfaces(package)
        commands.run(log, cmake, "--install", folder)
        shutil.copy(folder / "install_manifest.txt", STAMPS / f"{package}.files")
        stamp(f"interfaces-{package}", interface_key(package))
        state[package] = "done"

    futures = [pool.submit(build, package) for package in stale]
    step.follow(
        futures, lambda: ", ".join(f"{name} {text}" for name, text in state.items() if text not in ("", "done"))
    )


# --- all of it --------------------------------------------------------------------------------------------------------


def steps_to_do() -> list[tuple[str, Callable[[Step, ThreadPoolExecutor, Commands], None]]]:
    known = {path.name.removesuffix(".files") for path in STAMPS.glob("*.files")}
    for gone in known - set(packages()):
        uninstall_interfaces(gone)
    fresh = not is_stamped("venv", venv_key()) or (STAMPS / "installing").exists()
    stale = [name for name in packages() if fresh or not is_stamped(f"interfaces-{name}", interface_key(name))]

    def interfaces(step: Step, pool: ThreadPoolExecutor, commands: Commands) -> None:
        build_interfaces(stale, step, pool, commands)

    steps = (
        (fresh, "environment", make_venv),
        (fresh or not is_stamped("packages", digest(LOCK)), "packages", install_packages),
        (fresh or not is_stamped("project", project_key()), "project", install_project),
        (bool(stale), "message packages", interfaces),
    )
    return [(title, run) for due, title, run in steps if due]


def set_up() -> None:
    steps = steps_to_do()
    if not steps:
        return
    began_s = time.monotonic()
    if os.environ.get("AMENT_PREFIX_PATH"):
        print("A ROS installation is sourced in this shell. It is left out: .venv brings its own ROS 2.")
    print(f"Setting up .venv: {len(steps)} steps, logs in {LOGS.relative_to(ROOT)}/", flush=True)
    for log in LOGS.glob("*.log"):
        log.unlink()
    commands = Commands()
    with ThreadPoolExecutor(CORES) as pool:
        try:
            for number, (title, run) in enumerate(steps, 1):
                with Step(number, len(steps), title) as step:
                    run(step, pool, commands)
        finally:
            commands.stop()
            pool.shutdown(cancel_futures=True)
    print(f".venv is ready after {time.monotonic() - began_s:.0f} s.", flush=True)


def only_one_at_a_time() -> int:
    LOGS.mkdir(parents=True, exist_ok=True)
    lock = os.open(LOGS / "lock", os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print("Another make setup is at work in this checkout; waiting for it.", flush=True)
        fcntl.flock(lock, fcntl.LOCK_EX)
    return lock


def main() -> int:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    only_one_at_a_time()
    try:
        set_up()
    except SetUpError as error:
        print(f"\nmake setup: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nmake setup: interrupted; run it again and it goes on from here.", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
