"""All packages except nodes/ can be imported without ROS."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from servoloop.extras import LIBRARIES

ROOT = Path(__file__).parents[2]

PROGRAM = """
import importlib, pkgutil, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top == "rclpy" or top.endswith(("_msgs", "_interfaces")):
            raise ImportError("no ROS here: " + name)

sys.meta_path.insert(0, NoRos())
for package in ("drivers", "hal", "commissioning", "controller", "sim_backend", "servoloop"):
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
            print(module.name)
"""


@pytest.mark.slow
def test_all_packages_except_nodes_import_without_ros() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "servoloop.simulation.simulate" in done.stdout and "controller.loop" in done.stdout


def test_the_tools_for_ports_and_servos_need_no_compiled_packages() -> None:
    """The tools need no physics engine, ROS or numpy, so they run on any machine with a USB port."""
    tools = "commissioning.ports.plugging, commissioning.scan.scan, commissioning.registers.address"
    heavy = ("mujoco", "numba", "numpy", "ruckig", "rclpy", "PIL")
    program = f"import sys, {tools}, commissioning.registers.access; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, "[]"), done.stderr


def test_a_stack_on_real_servos_loads_no_library_of_an_extra() -> None:
    """Loading the simulation would take almost a second and 90 MB."""
    heavy = [module for libraries in LIBRARIES.values() for module in libraries]
    program = f"import sys, servoloop.cli, servoloop.up; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, "[]"), done.stderr


def test_stop_starts_without_the_libraries_of_other_commands() -> None:
    """An arm must stop soon after the user has pressed Enter."""
    heavy = ("numpy", "numba", "ruckig", "rclpy", "servoloop.up", "servoloop.stack.robot_files")
    used = "servoloop.cli, servoloop.commands.jog, servoloop.command_socket.client"
    program = f"import sys, {used}; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, "[]"), done.stderr


def test_servoloop_is_imported_within_300_ms() -> None:
    program = "import time; begin_s = time.process_time(); import servoloop; print(time.process_time() - begin_s)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert float(done.stdout) < 0.3, done


def start(*arguments: str, log: Path | None = None) -> "subprocess.Popen[str]":
    out = log.open("w") if log else subprocess.PIPE
    command = [sys.executable, "-m", "tests.servoloop.without", "ros", *arguments]
    return subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, text=True, cwd=ROOT)


@pytest.mark.slow
@pytest.mark.runs("servoloop bench bus --port /dev/ttyACM0 --ids 1-7", "servoloop emulate ./bus")
def test_virtual_servos_and_the_bench_run_without_ros(tmp_path: Path) -> None:
    """A Raspberry Pi without ROS can serve virtual servos and measure a bus."""
    link = tmp_path / "bus"
    emulator = start("emulate", str(link), log=tmp_path / "emulate.log")
    try:
        deadline_s = time.monotonic() + 60.0
        while not link.exists():
            assert emulator.poll() is None, (tmp_path / "emulate.log").read_text()
            assert time.monotonic() < deadline_s, "never came"
            time.sleep(0.05)
        bench = start("bench", "bus", "--port", str(link), "--ids", "1-7", "--cycles", "20", "--json")
        out, _ = bench.communicate(timeout=60)
        assert bench.returncode == 0, out
        assert json.loads(out.splitlines()[-1])["faults"]["silent"] == 0
    finally:
        emulator.send_signal(signal.SIGINT)
        assert emulator.wait(60) == 0


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["--help"], 0, "Run the control stack of an arm until Ctrl-C"),
        (["bench", "bus", "--help"], 0, "--ids"),
        (["ports", "--json"], 0, '"udev_rule"'),
        (["scan", "/dev/ttyACM77"], 1, "/dev/ttyACM77 does not exist"),
        (
            ["up", "--hardware", "mock", "--rtf", "5", "--step"],
            1,
            "--step requires ROS, but the stack runs without",
        ),
        (["pick", "A"], 1, "ROS 2 Jazzy is required, but Python cannot find rclpy"),
    ],
    ids=["help", "bench", "ports", "scan", "up", "pick"],
)
def test_only_commands_that_need_ros_report_that_it_is_missing(arguments: list[str], status: int, words: str) -> None:
    verb = start(*arguments)
    out, _ = verb.communicate(timeout=60)
    assert (verb.returncode, words in out) == (status, True), out
