"""The demo sorts an apple by the pictures of the virtual camera, from the picture to the bin."""

import io
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from PIL import Image
from rich.console import Console

pytest.importorskip("cv2")

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CompressedImage

from nodes.clients.camera_pictures import PICTURES
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.jobs import Live
from servoloop.demo.sort_apples import sort_apples
from servoloop.demo.sorting_report import print_sorting, write_sorting

pytestmark = pytest.mark.slow


COMMAND = "servoloop demo --vision"
LONGEST_S = 500.0


@pytest.mark.runs(COMMAND)
def test_the_command_sorts_twelve_apples(ros_domain: int, tmp_path: Path) -> None:
    words = shlex.split(f"{COMMAND} --out {tmp_path}")[1:]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(ros_domain), "COLUMNS": "100"}
    command = [sys.executable, "-m", "servoloop", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "apples in the right bins: 12 of 12" in done.stdout
    grades = {apple["true"]["grade"] for apple in json.loads((tmp_path / "result.json").read_text())["sorted"]}
    assert grades == {"A", "B", "C"}


def test_two_apples_are_sorted_with_a_small_arm(ros_domain: int, tmp_path: Path) -> None:
    words = io.StringIO()
    console = Console(file=words, width=200)
    recording = tmp_path / "run.mcap"
    options = CellOptions(tmp_path, arm="so101", vision=True, record=recording)
    report = sort_apples(options, Live(console), 2)
    print_sorting(report, console)
    assert report.success, words.getvalue()
    assert "apples in the right bins: 2 of 2" in words.getvalue()
    assert report.median_picture_to_goal_s is not None and report.median_picture_to_goal_s < 1.0
    write_sorting(report, tmp_path / "result.json")
    sorted_apples = json.loads((tmp_path / "result.json").read_text())["sorted"]
    for apple in sorted_apples:
        assert apple["seen"]["diameter_mm"] == pytest.approx(apple["true"]["diameter_mm"], abs=3.0)
        assert apple["seen"]["grade"] == apple["true"]["grade"] == apple["bin"]
    assert Image.open(tmp_path / "apple.png").size == (640, 480)
    assert Image.open(tmp_path / "sorting.gif").n_frames > 10  # type: ignore[attr-defined]
    pictures = pictures_of(recording)
    assert len(pictures) > 50 and pictures[0].size == (640, 480)


def pictures_of(recording: Path) -> list[Image.Image]:
    """Return the compressed pictures of a recording that also contains the messages of the stack."""
    pictures, topics = [], set()
    with recording.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            topics.add(channel.topic)
            if channel.topic == f"/{PICTURES}":
                assert message.log_time > 0
                pictures.append(Image.open(io.BytesIO(deserialize_message(message.data, CompressedImage).data)))
    assert {"/joint_states", "/arm_controller/controller_state"} <= topics
    return pictures
