"""Pictures of cameras on the page, without a browser and without ROS."""

import base64
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from servoloop.dashboard.camera_folder import CameraFolder, html
from servoloop.dashboard.server import PageServer
from servoloop.demo.camera_recording import CameraRecording
from servoloop.recording.mcap_messages import Received
from servoloop.recording.pictures import CameraPicture
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.sources import PlayedRecording
from tests.recorder.rig import Rig
from tests.vision.test_camera_recording import TOPIC, picture

PIXELS = b"\xff\xd8 a picture"


@pytest.fixture
def server() -> Iterator[PageServer]:
    server = PageServer(port=0)
    yield server
    server.stop()


def received(data: bytes, format: str = "jpeg") -> Received:
    message = SimpleNamespace(format=format, data=np.frombuffer(data, np.uint8))
    return Received(TOPIC, 1, message, 0)


def test_the_newest_picture_of_a_camera_is_shown_unchanged(server: PageServer) -> None:
    folder, watched = CameraFolder(server, 0.5), ObservedRobot()
    folder.show(watched)
    for data in (b"older", PIXELS):
        watched.take(received(data))
        folder.show(watched)
    picture_shown = watched.pictures.newest[TOPIC]
    assert picture_shown == CameraPicture("jpeg", PIXELS)
    text = html(TOPIC, picture_shown)
    assert base64.b64encode(PIXELS).decode() in text and "image/jpeg" in text and "/apple_camera/image_raw<" in text
    assert folder._places[TOPIC].content == text


def test_a_camera_that_has_ended_disappears(server: PageServer) -> None:
    live = {"/a/image_raw/compressed": CameraPicture("rgb8; jpeg compressed bgr8", PIXELS)}
    pictures = [live, {}]
    folder = CameraFolder(server, 0.5, lambda: pictures[0])
    folder.show(ObservedRobot())
    assert [*folder._places] == [*live]
    pictures.pop(0)
    folder.show(ObservedRobot())
    assert not folder._places and folder._folder is None


def test_an_encoding_that_no_browser_shows_is_left_out(server: PageServer) -> None:
    folder, watched = CameraFolder(server, 0.5), ObservedRobot()
    watched.take(received(PIXELS, "h264"))
    folder.show(watched)
    assert not folder._places


def test_the_pictures_of_a_recording_follow_the_playback(tmp_path: Path) -> None:
    rig, path = Rig(), tmp_path / "run.mcap"
    rig.run(1.0)
    rig.record(path)
    begin_ns = round(rig.samples[0].state.stamp_s * 1e9)
    pictures = CameraRecording(path, TOPIC)
    for number, at_s in ((1, 0.2), (2, 0.7)):
        pictures.add(begin_ns + round(at_s * 1e9), picture(number))
    pictures.finish()
    recording = PlayedRecording(path)
    shown = [recording.play_to(at_s).pictures.newest.get(TOPIC) for at_s in (0.1, 0.4, 0.8, 0.3)]
    assert [one and one.data[0] for one in shown] == [None, 1, 2, 1]
