"""LeRobot's own commands with two virtual SO-101, each in the process of its ``servoloop up``.

LeRobot runs in a separate environment, with the wheel of the plugin.
"""

import json
import os
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from servoloop import Arm, ArmBusyError
from tests.integrations.lerobot.environment import lerobot_environment
from tests.integrations.lerobot.plugin import install_plugin
from tests.live.rig import runtime_folder
from tests.pages import commands
from tests.servoloop.up_process import running_up

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

HERE = Path(__file__).parent
LEROBOT_S = 300.0
"""Maximum time of one of LeRobot's commands on a busy machine, in seconds. The start of LeRobot alone takes half a
minute."""
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
FEATURES = [f"{joint}.pos" for joint in JOINTS]
UP = ("servoloop up --no-ros --arm so101_leader", "servoloop up --no-ros --arm so101")
TELEOPERATE = (
    "lerobot-teleoperate --robot.type=servoloop --robot.arm=so101 --teleop.type=servoloop --teleop.arm=so101_leader "
    "--fps=30 --teleop_time_s=5"
)
RECORD = (
    "lerobot-record --robot.type=servoloop --robot.arm=so101 --teleop.type=servoloop --teleop.arm=so101_leader "
    '--dataset.repo_id=me/cubes --dataset.single_task="Sort cubes" --dataset.num_episodes=1 '
    "--dataset.episode_time_s=5 --dataset.push_to_hub=false"
)
KEEP_TORQUE = "--teleop.release_torque=false"
"""Option with which a program moves the virtual leader."""


class LeRobot:
    """LeRobot with the plugin, as LeRobot's commands see it."""

    def __init__(self, environment: Path, folder: Path) -> None:
        self.home = folder / "home"
        self._bin = environment / "bin"
        self.variables = {
            **os.environ,
            "PATH": f"{self._bin}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(install_plugin(folder)),
            "HF_HOME": str(self.home),
            "HF_LEROBOT_HOME": str(self.home / "lerobot"),
            "HF_HUB_OFFLINE": "1",
        }

    def run(self, command: str) -> "subprocess.CompletedProcess[str]":
        """Run a command in the shell, as a user types it."""
        return subprocess.run(
            ["sh", "-c", command],
            env=self.variables,
            cwd=self.home.parent,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LEROBOT_S,
        )

    def dataset(self) -> dict[str, Any]:
        """Return a summary of the newest dataset."""
        root = max((self.home / "lerobot" / "me").iterdir(), key=lambda path: path.stat().st_mtime)
        done = self.run(f"python {HERE / 'recorded.py'} {root}")
        assert done.returncode == 0, done.stdout
        summary: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return summary


@pytest.fixture(scope="module")
def lerobot(tmp_path_factory: pytest.TempPathFactory) -> LeRobot:
    return LeRobot(lerobot_environment(), tmp_path_factory.mktemp("lerobot"))


@pytest.fixture(scope="module")
def arms(lerobot: LeRobot, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Run the leader and the follower."""
    folder = tmp_path_factory.mktemp("arms")
    with pytest.MonkeyPatch.context() as patch, ExitStack() as stacks:
        lerobot.variables["XDG_RUNTIME_DIR"] = str(stacks.enter_context(runtime_folder(patch)))
        for command in UP:
            stacks.enter_context(running_up(folder, *command.split()[2:]))
        yield


@contextmanager
def moving_leader() -> Iterator[None]:
    """Unfold both arms, and move the leader back and forth, as a hand would, until the end of the block."""
    for name in ("so101", "so101_leader"):  # in the folded pose, the jaws would hit the bins
        with Arm.connect(name) as arm:
            arm.move_to(dict.fromkeys(JOINTS[:5], 0.0), speed=0.25)
    ended = threading.Event()

    def swing() -> None:
        with Arm.connect("so101_leader") as leader:
            while not ended.is_set():
                for at in (0.5, -0.5):
                    leader.move_to({"shoulder_pan": at, "gripper": at + 0.6}, duration=2.0)

    thread = threading.Thread(target=swing)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(60.0)


def test_commands_are_those_of_the_page() -> None:
    assert commands("lerobot.md")[1:] == [*UP, TELEOPERATE, RECORD]


@pytest.mark.runs(*UP, RECORD)
def test_lerobot_records_a_dataset_of_two_virtual_arms(lerobot: LeRobot, arms: None) -> None:
    with moving_leader():
        done = lerobot.run(f"{RECORD} {KEEP_TORQUE} --play_sounds=false")
    assert done.returncode == 0, done.stdout
    dataset = lerobot.dataset()
    assert dataset["robot"] == "servoloop" and dataset["names"] == [FEATURES, FEATURES]
    assert 4.0 < dataset["time_s"][-1] <= 5.1 and len(dataset["time_s"]) == len(dataset["state"])
    for joint, spread in ((0, 20.0), (5, 20.0)):
        action, state = ([row[joint] for row in dataset[key]] for key in ("action", "state"))
        assert max(action) - min(action) > spread
        assert max(state) - min(state) > 0.7 * (max(action) - min(action))
    gripper = [row[5] for row in dataset["action"]]
    assert min(gripper) > -5.0 and max(gripper) < 105.0


@pytest.mark.runs(TELEOPERATE)
def test_lerobot_teleoperates_and_leaves_the_leader_limp(lerobot: LeRobot, arms: None) -> None:
    done = lerobot.run(TELEOPERATE)
    assert done.returncode == 0, done.stdout
    with Arm.connect("so101") as follower, Arm.connect("so101_leader") as leader:
        with pytest.raises(ArmBusyError, match="its torque is off"):
            leader.move_to({"shoulder_pan": 0.0})
        for joint in JOINTS[:5]:
            assert follower.state.command[joint] == pytest.approx(leader.state.position[joint], abs=0.05)
        follower.move_to({"shoulder_pan": 0.1}, speed=0.5)  # no other client has control of the arm


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--robot.arm=koch", "no stack of koch is running. Running stacks: so101 (process"),
        ("--robot.arm=so101 --robot.joints='[jaw]'", "so101 has no joint 'jaw': its joints are shoulder_pan,"),
    ],
)
def test_a_wrong_option_is_one_sentence(options: str, words: str, lerobot: LeRobot, arms: None) -> None:
    done = lerobot.run(TELEOPERATE.replace("--robot.arm=so101", options) + f" {KEEP_TORQUE}")
    assert done.returncode != 0
    *_, last = (line for line in done.stdout.splitlines() if line.strip())
    assert last.startswith("lerobot.utils.errors.DeviceNotConnectedError: ") and words in last


def test_the_robot_class_with_a_camera_until_the_stack_is_killed(lerobot: LeRobot, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch, runtime_folder(patch) as folder:
        lerobot.variables["XDG_RUNTIME_DIR"] = str(folder)
        with running_up(tmp_path, *UP[1].split()[2:]) as process:
            done = lerobot.run(f"python {HERE / 'connected_robot.py'} {process.pid}")
    assert done.returncode == 0, done.stdout
    shown = [line for line in done.stdout.splitlines() if line.startswith(("Device", "image", "moved", "Stack"))]
    assert shown == [
        "DeviceNotConnectedError ServoloopRobot is not connected. Run `.connect()` first.",
        "DeviceAlreadyConnectedError ServoloopRobot is already connected.",
        "image (4, 6, 3)",
        "moved by 5",
        "StackError the action for gripper is nan: send a finite number",
        f"DeviceNotConnectedError the connection to the stack of so101 (process {process.pid}) has ended: start "
        "`servoloop up` again",
    ]
