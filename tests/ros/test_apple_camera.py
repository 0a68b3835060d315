"""The camera node over ROS: its topics, the grades, and the reports if no picture is graded."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import rclpy
from apple_quality_msgs.msg import AppleQualityArray
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from nodes.perception.node import CameraNode
from perception.camera_view import pose_text
from perception.grading_loop import GradingStatus
from perception.intrinsics import intrinsics_text
from tests.perception import painted
from tests.ros.stack_process import StackProcess, until

DEADLINE_S = 30.0
TOPICS = {
    "/apple_camera/image_raw": (Image, qos_profile_sensor_data),
    "/apple_camera/image_raw/compressed": (CompressedImage, qos_profile_sensor_data),
    "/apple_camera/camera_info": (CameraInfo, qos_profile_sensor_data),
    "/apple_camera/image_annotated": (Image, qos_profile_sensor_data),
    "/sorting/perception/apple_quality": (AppleQualityArray, 10),
    "/sorting/perception/apple_poses": (PoseArray, 10),
    "/diagnostics": (DiagnosticArray, 10),
}


class Heard:
    """Subscriber to all topics of the node."""

    def __init__(self) -> None:
        rclpy.init()
        self.messages: dict[str, list[Any]] = {topic: [] for topic in TOPICS}
        self.node = rclpy.create_node("client")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        for topic, (kind, qos) in TOPICS.items():
            self.node.create_subscription(kind, topic, self.messages[topic].append, qos)

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        end_s = time.monotonic() + DEADLINE_S
        while not (found := condition()):
            assert time.monotonic() < end_s, f"not within {DEADLINE_S} s: {what}"
            self._executor.spin_once(timeout_sec=0.1)
        return found

    def reported(self, text: str) -> Any:
        """Wait for a report of /diagnostics whose message contains a text."""
        return self.until(
            lambda: [m.status[0] for m in self.messages["/diagnostics"] if text in m.status[0].message], text
        )[0]

    def of_one_image(self) -> tuple[Any, Any] | None:
        """Return the grades and the poses of the same image. The first messages of a topic may be lost during
        discovery."""
        poses = {_stamp(message): message for message in self.messages["/sorting/perception/apple_poses"]}
        arrays = self.messages["/sorting/perception/apple_quality"]
        return next(((array, poses[_stamp(array)]) for array in arrays if _stamp(array) in poses), None)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()


def _stamp(message: Any) -> tuple[int, int]:
    return message.header.stamp.sec, message.header.stamp.nanosec


@pytest.fixture
def heard(ros_domain: int) -> Iterator[Heard]:
    heard = Heard()
    yield heard
    heard.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a calibration, and with pictures of two apples."""
    folder, view = tmp_path_factory.mktemp("camera"), painted.view()
    (folder / "camera.yaml").write_text(intrinsics_text(view.intrinsics))
    (folder / "camera_pose.yaml").write_text(pose_text(view.pose))
    (folder / "pictures").mkdir()
    apples = [
        painted.PaintedApple(np.array([0.2, y, 0.03]), 0.03, painted.GREEN, share, np.array([0.0, 0.0, 1.0]))
        for y, share in ((-0.06, 1.0), (0.06, 0.0))
    ]
    for seed in range(60):
        if seed < 2:
            picture, _ = painted.paint(view, apples, painted.Lamp(lamp=0.7), seed)
        cv2.imwrite(str(folder / f"pictures/{seed:03}.png"), picture[..., ::-1])
    return folder


@contextmanager
def camera(folder: Path, **parameters: str) -> Iterator[subprocess.Popen[str]]:
    arguments = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    command = [sys.executable, "-m", "nodes.apple_camera", "--ros-args", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    with subprocess.Popen(
        command, cwd=folder, env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    ) as process:
        try:
            yield process
        finally:
            process.terminate()
            _, log = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0 and "Traceback" not in log, log


def test_each_mistake_has_its_own_line_in_the_log() -> None:
    lines: list[str] = []
    camera = object.__new__(CameraNode)
    camera._logged, camera._node = "", SimpleNamespace(get_logger=lambda: SimpleNamespace(error=lines.append))
    camera._set(GradingStatus(False, "grades.yaml:2: wrong\ngrades.yaml:3: wrong"))
    assert lines == ["no images are graded: grades.yaml:2: wrong\ngrades.yaml:3: wrong"]


@pytest.mark.runs("python -m nodes.apple_camera --ros-args -p source:=pictures")
def test_apples_are_published_with_their_places_and_pictures(heard: Heard, folder: Path) -> None:
    with camera(folder, source="pictures"):
        heard.until(lambda: all(heard.messages.values()), "a message of each topic")
        array, poses = heard.until(heard.of_one_image, "the grades and the poses of one image")
        report = heard.reported("2 apples in the image")
    assert sorted(apple.grade for apple in array.apples) == ["A", "B"]
    assert poses.header.frame_id == "base_link"
    for apple, pose in zip(array.apples, poses.poses, strict=True):
        assert apple.diameter_mm == pytest.approx(60.0, abs=2.0)
        assert pose.position.y == pytest.approx(-0.06 if apple.grade == "A" else 0.06, abs=0.003)
    image, info = heard.messages["/apple_camera/image_raw"][0], heard.messages["/apple_camera/camera_info"][0]
    assert (image.encoding, image.width, image.height, len(image.data)) == ("rgb8", 640, 480, 640 * 480 * 3)
    assert image.header.frame_id == info.header.frame_id == array.header.frame_id == "camera_optical_frame"
    assert info.k[0] == 620.0 and info.distortion_model == "plumb_bob" and info.p[2] == info.k[2]
    jpeg = heard.messages["/apple_camera/image_raw/compressed"][0]
    assert "jpeg" in jpeg.format and cv2.imdecode(np.array(jpeg.data, np.uint8), 1).shape == (480, 640, 3)
    assert abs(time.time() - array.header.stamp.sec) < DEADLINE_S
    assert report.level == b"\x00" and {value.key for value in report.values} >= {"rate_hz", "lost_frames"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"source": "/dev/video99"}, "no images are graded: there is no camera /dev/video99"),
        ({}, "no camera is specified"),
        ({"source": "0", "rate_hz": "30"}, "there is no camera /dev/video0"),
        ({"source": "pictures", "rate_hz": "fast"}, "parameter 'rate_hz' is 'fast': set it to a number"),
        ({"source": "true"}, "parameter 'source' is True: set it to a text"),
        ({"source": "pictures", "camera_file": "nothing.yaml"}, "cannot read nothing.yaml"),
        ({"source": "pictures", "grades_file": "grades.yaml"}, "grades A (line 2) and B overlap"),
        ({"source": "pictures", "detector": "onnx", "model_file": "grades.yaml"}, "parameter 'classes_file' is empty"),
        (
            {"source": "pictures", "detector": "onnx", "model_file": "grades.yaml", "classes_file": "classes.yaml"},
            "grades.yaml is not a runnable ONNX model",
        ),
        ({"source": "black"}, "the image is almost black"),
    ],
)
def test_bad_input_is_reported_and_nothing_is_graded(
    heard: Heard, folder: Path, parameters: dict[str, str], message: str
) -> None:
    (folder / "grades.yaml").write_text("grades:\n  - {grade: A}\n  - {grade: B}\n")
    (folder / "classes.yaml").write_text("classes: [good]\ngrades: {good: A}\n")
    (folder / "black").mkdir(exist_ok=True)
    for number in range(30):
        cv2.imwrite(str(folder / f"black/{number:02}.png"), np.zeros((480, 640, 3), np.uint8))
    with camera(folder, **parameters):
        report = heard.reported(message)
    assert report.level == b"\x02" and not heard.messages["/sorting/perception/apple_quality"]


@pytest.mark.slow
def test_parameter_without_effect_is_reported(ros_domain: int, tmp_path: Path) -> None:
    arguments = ["--ros-args", "-p", "grade_file:=grades.yaml", "-p", "source:=true", "-p", "rate_hz:=10"]
    node = StackProcess(tmp_path / "node.log", *arguments, module="nodes.apple_camera")
    try:
        until(lambda: "parameter 'grade_file' is ignored: this node has no parameter with that name" in node.words)
    finally:
        assert node.end() == 0
    assert node.words.count("is ignored") == 1
