"""Run every command of docs/getting-started-so101.md in order, on a virtual box of factory-new servos."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from math import tau
from pathlib import Path
from typing import Any

import pytest

from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator import couplings
from servoloop.stack.shipped_files import ARMS
from sim_backend.buses.mounting import Mounting
from sim_backend.scene.world_feed import WorldFeedClient, feed_path
from tests.commissioning.practice import UPRIGHT, follow, take, tell
from tests.pages import commands
from tests.ros.stack_process import StackProcess, until

pytestmark = pytest.mark.slow

PAGE = "getting-started-so101.md"
PORT = "--port /dev/ttyACM0"
NODE = "python -m nodes.vision_pick_place_controller --ros-args --params-file config/arms/so101/pick_place.yaml"
STEPS = [
    "servoloop ports",
    f"servoloop setup --arm so101 {PORT}",
    "servoloop scan /dev/ttyACM0",
    f"servoloop calibrate --arm so101 {PORT}",
    f"servoloop doctor --arm so101 {PORT}",
    f"servoloop passport save so101.passport.yaml --arm so101 {PORT}",
    f"servoloop up --arm so101 {PORT}",
    NODE,
    "servoloop pick B",
    "servoloop emulate ./bus --arm so101 --box",
    *(f"servoloop hand ./bus {do}" for do in ("connect gripper", "connect", "hold", "move elbow_flex -0.5")),
    *(f"servoloop hand ./bus {do}" for do in ("release", "lay")),
]


def test_page_has_these_commands_in_order() -> None:
    assert [command for command in commands(PAGE) if not command.startswith("python tools/")] == STEPS


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """Copy the folder of the arm, because its calibration is written there."""
    return Path(shutil.copytree(ARMS / "so101", tmp_path / "so101"))


@pytest.fixture
def link(arm: Path) -> Iterator[Path]:
    link = arm.parent / "bus"
    emulator = StackProcess(arm.parent / "emulate.log", "emulate", str(link), "--arm", str(arm), "--box")
    try:
        emulator.wait_for(link)
        yield link
    finally:
        emulator.end()


def once(*arguments: str) -> str:
    done = subprocess.run([sys.executable, "-m", "servoloop", *arguments], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.runs(*STEPS, *commands("setup.md"))
@pytest.mark.timeout(400)
def test_commands_lead_from_new_servos_to_a_sorted_cube(arm: Path, link: Path, ros_domain: int) -> None:
    of_arm = ("--arm", str(arm), "--port", str(link))
    once("ports")
    status, printed, said = follow(link, "setup", *of_arm)
    assert status == 0, printed + said
    found = json.loads(once("scan", str(link), "--json"))
    assert [servo["servo_id"] for servo in found["servos"]] == [1, 2, 3, 4, 5, 6]
    tell(link, "hold")
    take(link, UPRIGHT)
    status, printed, said = follow(link, "calibrate", *of_arm, "--yes", "--json")
    assert status == 0, printed + said
    _assert_as_mounted(json.loads(printed)["joints"])
    tell(link, "release")
    once("doctor", *of_arm)
    once("passport", "save", str(arm.parent / "so101.passport.yaml"), *of_arm)
    once("hand", str(link), "lay")
    _sort(arm, link)


def _assert_as_mounted(joints: dict[str, Any]) -> None:
    """Check that every direction and zero matches the virtual arm."""
    for true in Mounting(0).couplings(couplings(read_arm_files(find_arm("so101")).robot)):
        made = joints[true.joint]
        off = (made["zero_counts"] + (made["homing_offset"] or 0) - true.zero_counts + 2048) % 4096 - 2048
        assert made["sign"] == true.sign and abs(off) * tau / 4096 <= 0.03, true.joint
        assert made["doubt"] is None, true.joint


def _sort(arm: Path, link: Path) -> None:
    """Run the stack, the node and one job with the new configuration."""
    feed = WorldFeedClient(feed_path(link))
    ready = arm.parent / "ready"
    stack = StackProcess(
        arm.parent / "up.log", "up", "--arm", str(arm), "--port", str(link), "--ready-file", str(ready)
    )
    node = None
    try:
        stack.wait_for(ready)
        arguments = ("--ros-args", "--params-file", str(arm / "pick_place.yaml"))
        node = StackProcess(arm.parent / "node.log", *arguments, module="nodes.vision_pick_place_controller")
        once("pick", "B")
        bins: list[object] = []

        def in_bin() -> bool:
            bins.extend(seen["cube_bins"]["cube"] for seen in feed.all())
            return "B" in bins

        until(in_bin)
    finally:
        if node is not None:
            node.end()
        stack.end()
        feed.close()
    assert "so101 holds its position with torque enabled (on_exit: hold)" in stack.words
