"""Create .venv with Python packages, this project, and the ROS 2 message packages in interfaces/, for `make setup`.

Each step writes a stamp with a hash of its sources into .venv. A second run therefore repeats only missing or outdated
steps, and an interrupted run continues where it stopped. This module uses only the standard library.
"""

import fcntl
import os
import signal
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from commands import Commands, ToolError
from interface_packages import packages
from places import LOCK, LOGS, ROOT, STAMPS
from progress import SetUpStep
from stamps import (
    digest,
    interface_key,
    is_stamped,
    moveit_py_key,
    project_key,
    ros2_cli_key,
    simulation_key,
    venv_key,
)
from steps import (
    CORES,
    build_interfaces,
    compile_simulation,
    install_moveit_py,
    install_packages,
    install_project,
    install_ros2_cli,
    is_moveit_present,
    is_ros2_present,
    make_venv,
    uninstall_interfaces,
)

OTHER_S = 7200.0
"""Maximum time to wait for another `make setup`, in seconds."""


def steps_to_do() -> list[tuple[str, Callable[[SetUpStep, ThreadPoolExecutor, Commands], None]]]:
    known = {path.name.removesuffix(".files") for path in STAMPS.glob("*.files")}
    for gone in known - set(packages()):
        uninstall_interfaces(gone)
    fresh = not is_stamped("venv", venv_key()) or (STAMPS / "installing").exists()
    stale = [name for name in packages() if fresh or not is_stamped(f"interfaces-{name}", interface_key(name))]

    def interfaces(step: SetUpStep, pool: ThreadPoolExecutor, commands: Commands) -> None:
        build_interfaces(stale, step, pool, commands)

    steps = (
        (fresh, "environment", make_venv),
        (fresh or not is_stamped("packages", digest(LOCK)), "packages", install_packages),
        (fresh or not is_stamped("project", project_key()), "project", install_project),
        (
            (fresh or not is_stamped("moveit_py", moveit_py_key())) and not is_moveit_present(),
            "Python interface of MoveIt",
            install_moveit_py,
        ),
        (
            (fresh or not is_stamped("ros2_cli", ros2_cli_key())) and not is_ros2_present(),
            "command ros2",
            install_ros2_cli,
        ),
        (bool(stale), "message packages", interfaces),
        (fresh or not is_stamped("simulation", simulation_key()), "simulation", compile_simulation),
    )
    return [(title, run) for due, title, run in steps if due]


def set_up() -> None:
    steps = steps_to_do()
    if not steps:
        return
    began_s = time.monotonic()
    if os.environ.get("AMENT_PREFIX_PATH"):
        print("The ROS installation that is sourced in this shell is ignored, because .venv contains its own ROS 2.")
    print(f"Setting up .venv: {len(steps)} steps, logs in {LOGS.relative_to(ROOT)}/", flush=True)
    for log in LOGS.glob("*.log"):
        log.unlink()
    commands = Commands()
    with ThreadPoolExecutor(CORES) as pool:
        try:
            for number, (title, run) in enumerate(steps, 1):
                with SetUpStep(number, len(steps), title) as step:
                    run(step, pool, commands)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            commands.stop()
    print(f".venv is ready after {time.monotonic() - began_s:.0f} s.", flush=True)


def only_one_at_a_time(patience_s: float = OTHER_S) -> int:
    LOGS.mkdir(parents=True, exist_ok=True)
    lock = os.open(LOGS / "lock", os.O_RDWR | os.O_CREAT)
    deadline_s = time.monotonic() + patience_s
    said = False
    while not locked(lock):
        if not said:
            print("Another make setup is running in this checkout; waiting until it finishes.", flush=True)
            said = True
        if time.monotonic() > deadline_s:
            raise ToolError(
                f"the other make setup did not finish within {patience_s / 60.0:.0f} minutes: stop it first."
            )
        time.sleep(0.2)
    return lock


def locked(lock: int) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def main() -> int:
    for number in (
        signal.SIGTERM,
        signal.SIGHUP,
    ):  # Commands that are running have their own sessions, so they do not receive these signals.
        signal.signal(number, signal.default_int_handler)
    try:
        only_one_at_a_time()
        set_up()
    except (ToolError, OSError) as error:  # For example, the disk is full, or the folder belongs to another user.
        print(f"\nmake setup: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nmake setup: interrupted; run it again to continue from here.", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
