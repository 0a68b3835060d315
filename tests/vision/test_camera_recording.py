"""Pictures that are added to the recording of a stack."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from drivers.driver_errors import DriverError
from servoloop.demo.camera_recording import CameraRecording
from servoloop.recording.mcap import McapFile, RecordingError
from servoloop.recording.message_types import PICTURE, STRING, definition

TOPIC = "/apple_camera/image_raw/compressed"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A recording with two messages and metadata."""
    path = tmp_path / "run.mcap"
    run = McapFile(path)
    run.add_channel("/words", STRING, definition(STRING))
    for stamp_ns in (100, 300):
        run.add_message("/words", stamp_ns, b"\0\1\0\0")
    run.add_metadata("stack", {"arm": "robot_arm"})
    run.close()
    return path


def picture(number: int) -> bytes:
    store = get_typestore(Stores.ROS2_JAZZY)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=number)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera_optical_frame")
    message = store.types[PICTURE](header=header, format="jpeg", data=np.full(9, number, np.uint8))
    return bytes(store.serialize_cdr(message, PICTURE))


def test_pictures_are_added_in_the_order_of_time(recording: Path) -> None:
    pictures = CameraRecording(recording, TOPIC)
    for stamp_ns in (50, 200):
        pictures.add(stamp_ns, picture(stamp_ns))
    pictures.finish()
    with recording.open("rb") as stream:
        reader = make_reader(stream)
        found = [(channel.topic, message.log_time) for _, channel, message in reader.iter_messages()]
        assert [one.metadata for one in reader.iter_metadata()] == [{"arm": "robot_arm"}]
        (schema,) = {schema.name for schema, channel, _ in reader.iter_messages(topics=[TOPIC]) if schema}
    assert found == [(TOPIC, 50), ("/words", 100), (TOPIC, 200), ("/words", 300)]
    assert schema == PICTURE
    assert [path.name for path in recording.parent.iterdir()] == ["run.mcap"]


def test_a_damaged_recording_leaves_the_pictures(recording: Path) -> None:
    recording.write_bytes(recording.read_bytes()[:40])
    pictures = CameraRecording(recording, TOPIC)
    pictures.add(50, picture(50))
    with pytest.raises(RecordingError, match=r"the images remain in .*run\.camera\.mcap"):
        pictures.finish()
    assert pictures.pictures.exists() and recording.exists()


@pytest.mark.parametrize("length", [0, 40, 150])
def test_a_failed_run_is_reported_instead_of_its_incomplete_recording(
    recording: Path, length: int, caplog: pytest.LogCaptureFixture
) -> None:
    recording.write_bytes(recording.read_bytes()[:length])
    with pytest.raises(DriverError, match="the stack has ended"), CameraRecording(recording, TOPIC):
        raise DriverError("the stack has ended")
    assert f"{recording}: the recording is incomplete or damaged; the images remain in" in caplog.text
    assert {path.name for path in recording.parent.iterdir()} == {"run.mcap", "run.camera.mcap"}


def test_without_a_recording_no_pictures_remain(tmp_path: Path) -> None:
    pictures = CameraRecording(tmp_path / "run.mcap", TOPIC)
    pictures.add(50, picture(50))
    pictures.finish()
    assert list(tmp_path.iterdir()) == []
