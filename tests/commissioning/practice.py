"""A simulated user who follows the instructions of the tools on a virtual SO-101."""

import subprocess
import sys
import time
from pathlib import Path

from sim_backend.control import ask, control_path

LOOK_S = 0.05
UPRIGHT = [("shoulder_lift", -1.1), ("wrist_flex", -0.5), ("elbow_flex", -0.5)]
SWEEP = [
    *[("elbow_flex", 1.75), ("elbow_flex", -1.75), ("wrist_flex", 1.75), ("wrist_flex", -1.75), ("wrist_flex", 0.0)],
    *[("shoulder_lift", 1.8), ("shoulder_lift", -1.8), ("shoulder_lift", 0.0), ("elbow_flex", -0.5)],
    *[("shoulder_pan", 2.0), ("shoulder_pan", -2.0), ("shoulder_pan", 0.0)],
    *[("wrist_roll", 2.9), ("wrist_roll", -2.8), ("wrist_roll", 0.5), ("gripper", 1.8), ("gripper", -0.2)],
]
"""Sweep during which the arm never touches the table."""


def tell(link: Path, do: str, *joints: str) -> None:
    """Send one command to the simulated hand."""
    ask(control_path(link), {"do": do, "joints": list(joints)})


def take(link: Path, ways: list[tuple[str, float]]) -> None:
    """Move joints to positions, one after the other."""
    for joint, position in ways:
        ask(control_path(link), {"do": "move", "joints": [joint], "position": position})
        while not ask(control_path(link), {"do": "look"})[joint]["arrived"]:
            time.sleep(LOOK_S)
        time.sleep(4 * LOOK_S)


def do(link: Path, text: str, prefix: str = "") -> str:
    """Follow one line of instructions and return the answer to type. ``prefix`` begins the names of the joints."""
    if "then press Enter" in text:
        _connect(link, text)
        return "\n"
    if "take your hands off" in text:
        tell(link, "release")
    if "torque will be disabled" in text:
        tell(link, "hold")
    if "press Enter when done" not in text:
        return ""
    joint = text.split(":")[0]
    if text.startswith("Move every joint"):
        take(link, [(prefix + joint, position) for joint, position in SWEEP])
    elif "straight above" in text:
        take(link, [(joint, 0.0487)])
    else:
        take(link, [(joint, ask(control_path(link), {"do": "look"})[joint]["position"] + 0.4)])
    return "\n"


def _connect(link: Path, text: str) -> None:
    named = [joint for joint in ask(control_path(link), {"do": "look"}) if f" {joint}" in text]
    tell(link, "connect", *(named if len(named) == 1 else []))


def follow(link: Path, *arguments: str, prefix: str = "") -> tuple[int, str, str]:
    """Run a command and follow its instructions; return its exit status, stdout and stderr.

    ``prefix`` begins the names of the joints of the arm that the command calibrates.
    """
    pipe = subprocess.PIPE
    command = [sys.executable, "-m", "servoloop", *arguments]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, bufsize=1) as process:
        assert process.stdin is not None and process.stdout is not None and process.stderr is not None
        said: list[str] = []
        for line in process.stderr:
            said.append(line)
            process.stdin.write(do(link, line.strip(), prefix))
            process.stdin.flush()
        return process.wait(), process.stdout.read(), "".join(said)
