"""Camera sources: cameras of the machine, recordings, and their failures."""

import os
import subprocess
import threading
import time
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.clock import MonotonicClock
from perception.perception_errors import (
    CameraBusy,
    CameraDenied,
    CameraError,
    CameraLost,
    CameraMissing,
    CameraSilent,
    SourceEnded,
)  # fmt: skip
from perception.sources.choice import source_of
from perception.sources.devices import cameras, find_device
from perception.sources.recorded import RecordedSource
from perception.sources.video_device import FROZEN_S, VideoDevice

CLOCK = MonotonicClock()


class FakeCapture:
    """A capture of OpenCV whose frames have the gray values that the test provides."""

    def __init__(self, size: tuple[int, int] = (64, 48), period_s: float = 0.01, age_s: float = 0.0) -> None:
        self.size, self.period_s, self.age_s = size, period_s, age_s
        self.frozen = self.unplugged = self.damaged = False
        self.silent, self.released = threading.Event(), 0
        self._value = 0

    def isOpened(self) -> bool:
        return True

    def read(self) -> tuple[bool, np.ndarray | None]:
        time.sleep(self.period_s)
        if self.silent.is_set():
            time.sleep(0.2)
        if self.damaged:
            self.damaged = False
            raise cv2.error("the buffer is empty")
        if self.unplugged:
            return False, None
        self._value = self._value if self.frozen else (self._value + 1) % 200
        picture = np.full((self.size[1], self.size[0], 3), self._value, np.uint8)
        picture[..., 0] = 250  # blue comes first
        return True, picture

    def get(self, prop: int) -> float:
        values = {cv2.CAP_PROP_FRAME_WIDTH: self.size[0], cv2.CAP_PROP_FRAME_HEIGHT: self.size[1]}
        return values.get(prop, 1000.0 * (CLOCK.now() - self.age_s) if self.age_s else 0.0)

    def release(self) -> None:
        self.released += 1


def device(capture: FakeCapture) -> VideoDevice:
    return VideoDevice("/dev/video7", CLOCK, (64, 48), 30.0, lambda *_: capture, lambda source: source)


def test_a_reader_gets_new_frames_in_rgb_and_the_true_rate() -> None:
    capture = FakeCapture()
    camera = device(capture)
    camera.open()
    frames = [camera.read(1.0) for _ in range(5)]
    camera.close()
    assert frames[0].rgb[0, 0, 2] == 250 and frames[0].size == (64, 48)
    assert [frame.number for frame in frames] == sorted({frame.number for frame in frames})
    assert all(one.stamp_s < two.stamp_s for one, two in pairwise(frames))
    assert 5.0 < camera.rate_hz < 110.0 and capture.released == 1


def test_a_slow_reader_gets_the_newest_frame() -> None:
    camera = device(FakeCapture())
    camera.open()
    camera.read(1.0)
    time.sleep(0.2)
    assert CLOCK.now() - camera.read(1.0).stamp_s < 0.1
    camera.close()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda capture: capture.silent.set(), CameraSilent, "delivered no frame in 0.1 s"),
        (lambda capture: setattr(capture, "unplugged", True), CameraLost, "/dev/video7 delivers no more frames"),
        (lambda capture: setattr(capture, "damaged", True), CameraLost, "/dev/video7 delivers no more frames"),
        (lambda capture: setattr(capture, "age_s", 3.0), CameraSilent, r"frames that are 3\.\d s old"),
    ],
)
def test_a_camera_that_fails_is_named(change, error: type[Exception], message: str) -> None:
    capture = FakeCapture()
    camera = device(capture)
    camera.open()
    camera.read(1.0)
    change(capture)
    with pytest.raises(error, match=message):
        for _ in range(20):
            camera.read(0.1)
    camera.close()


def test_a_frozen_picture_is_not_passed_on() -> None:
    capture = FakeCapture(period_s=0.05)
    camera = device(capture)
    camera.open()
    camera.read(1.0)
    capture.frozen = True
    end_s = time.monotonic() + FROZEN_S + 1.0
    with pytest.raises(CameraSilent, match="the same image for 2 s: unplug the camera"):
        while time.monotonic() < end_s:
            camera.read(1.0)
    capture.frozen = False
    time.sleep(0.2)
    assert camera.read(1.0).number > 30
    camera.close()


def test_another_picture_size_is_refused() -> None:
    capture = FakeCapture((320, 240))
    with pytest.raises(CameraError, match="delivers 320 × 240 pixels instead of 64 × 48"):
        device(capture).open()
    assert capture.released == 1


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """A file system with one camera, which has a second node for metadata."""
    (tmp_path / "dev/v4l/by-id").mkdir(parents=True)
    for number, index in ((0, 0), (1, 1)):
        (tmp_path / f"dev/video{number}").touch()
        folder = tmp_path / f"sys/class/video4linux/video{number}"
        folder.mkdir(parents=True)
        (folder / "name").write_text("HD Webcam\n")
        (folder / "index").write_text(f"{index}\n")
    (tmp_path / "dev/v4l/by-id/usb-HD_Webcam-video-index0").symlink_to(tmp_path / "dev/video0")
    return tmp_path


def test_a_camera_is_listed_once_with_its_permanent_name(machine: Path) -> None:
    [camera] = cameras(machine)
    assert (camera.device, camera.name) == ("/dev/video0", "HD Webcam")
    assert camera.by_id == "/dev/v4l/by-id/usb-HD_Webcam-video-index0" and camera.may_open
    assert find_device("0", machine) == "/dev/video0"


def test_a_missing_camera_is_answered_with_the_ones_that_exist(machine: Path) -> None:
    with pytest.raises(CameraMissing, match=r"no camera /dev/video3: choose /dev/v4l/by-id/usb-HD_Webcam.*HD Webcam"):
        find_device("3", machine)


def test_a_camera_that_another_program_uses_is_refused_with_its_name(machine: Path) -> None:
    with (machine / "dev/video0").open("rb") as held, subprocess.Popen(["sleep", "60"], stdin=held) as program:
        try:
            with pytest.raises(CameraBusy, match=rf"/dev/video0 is in use by sleep 60 \(process {program.pid}\)"):
                find_device("/dev/video0", machine)
            assert cameras(machine)[0].owners == (f"sleep 60 (process {program.pid})",)
        finally:
            program.kill()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open everything")
def test_a_camera_without_permission_names_the_group(machine: Path) -> None:
    (machine / "dev/video0").chmod(0)
    with pytest.raises(CameraDenied, match="may open /dev/video0: run 'sudo usermod -aG"):
        find_device("0", machine)


def test_a_folder_of_pictures_plays_in_order_and_ends(tmp_path: Path) -> None:
    for number in (2, 1):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((48, 64, 3), (0, 0, 10 * number), np.uint8))
    source = source_of(str(tmp_path), CLOCK, (64, 48), 30.0)
    source.open()
    first, second = source.read(1.0), source.read(1.0)
    assert (first.rgb[0, 0, 0], second.rgb[0, 0, 0]) == (10, 20) and second.number == 2
    assert second.stamp_s - first.stamp_s == pytest.approx(0.1, abs=0.05)
    with pytest.raises(SourceEnded, match="has no more images after image 2"):
        source.read(1.0)


def test_a_damaged_picture_of_a_folder_is_skipped(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((48, 64, 3), 10 * number, np.uint8))
    (tmp_path / "2.png").write_bytes(b"broken")
    source = RecordedSource(tmp_path, CLOCK)
    source.open()
    assert source.read(1.0).rgb[0, 0, 0] == 10
    with pytest.raises(CameraSilent, match=r"2\.png is not an image, or is damaged: remove the file"):
        source.read(1.0)
    frame = source.read(1.0)
    assert (frame.rgb[0, 0, 0], frame.number) == (30, 3)
    with pytest.raises(SourceEnded, match="has no more images after image 3"):
        source.read(1.0)


def test_a_video_plays_at_its_rate(tmp_path: Path) -> None:
    path = tmp_path / "run.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for number in range(4):
        writer.write(np.full((48, 64, 3), 40 * number, np.uint8))
    writer.release()
    source = RecordedSource(path, CLOCK)
    source.open()
    frames = [source.read(1.0) for _ in range(4)]
    assert source.rate_hz == pytest.approx(25.0, rel=0.4)
    assert abs(int(frames[3].rgb[20, 20, 1]) - 120) < 10
    source.close()


@pytest.mark.parametrize("source", ["a" * 300 + ".mp4", "/dev/" + "a" * 300, "9" * 5000])
def test_a_source_whose_path_is_too_long_is_refused(source: str) -> None:
    with pytest.raises(CameraError, match=r"(a|9){255}.* File name too long: check the path"):
        source_of(source, CLOCK, (64, 48), 30.0).open()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("name", ["a.png", "a.mp4", "."])
def test_a_recording_without_permission_is_refused(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "private"
    folder.mkdir()
    for hidden in (folder / name, folder):
        hidden.touch()
        hidden.chmod(0)
        with pytest.raises(CameraError, match=r"cannot read .*: Permission denied: check the path and its permissions"):
            RecordedSource(folder / name, CLOCK).open()
    folder.chmod(0o700)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("nothing", None, "there is no file or folder"),
        ("a.png", b"\x89PNG broken", "is not an image, or is damaged"),
        ("a.png", b"", "is not an image, or is damaged"),
        ("a.mp4", b"no video", "is not a video that OpenCV can read"),
    ],
)
def test_a_damaged_recording_is_named(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(CameraError, match=message):
        RecordedSource(tmp_path / name, CLOCK).open()
