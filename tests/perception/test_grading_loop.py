"""The loop that reads and grades pictures: failures of the camera, and frames that are not graded."""

from collections.abc import Iterator

import numpy as np

from perception.frames import Frame, Picture
from perception.grading.annotate import annotated
from perception.grading.grader import GradedApple
from perception.grading_loop import GradingLoop
from perception.perception_errors import CameraBusy, CameraLost, CameraSilent, PictureRefused, SourceEnded

APPLE = GradedApple("A", 70.0, 0.9, 0.0, np.array([0.2, 0.0, 0.03]), (300, 2, 60, 60))


class SteppedClock:
    """A clock that sleeps without waiting."""

    def __init__(self) -> None:
        self.time_s = 10.0

    def now(self) -> float:
        return self.time_s

    def sleep_until(self, deadline_s: float) -> None:
        self.time_s = max(self.time_s, deadline_s)


class ScriptedCamera:
    """A camera that delivers frames and errors in a given order."""

    name, rate_hz = "video9", 10.0

    def __init__(self, *events: Frame | Exception, opening: tuple[Exception | None, ...] = ()) -> None:
        self._events: Iterator[Frame | Exception] = iter(events)
        self._opening = iter(opening)
        self.opened = self.closed = 0

    def open(self) -> None:
        if error := next(self._opening, None):
            raise error
        self.opened += 1

    def read(self, timeout_s: float) -> Frame:
        event = next(self._events)
        if isinstance(event, Exception):
            raise event
        return event

    def close(self) -> None:
        self.closed += 1


def frame(number: int, value: int = 90) -> Frame:
    return Frame(np.full((48, 64, 3), value, np.uint8), 0.1 * number, number)


def grading(picture: Picture) -> list[GradedApple]:
    if not picture.any():
        raise PictureRefused("the picture is black")
    return [APPLE]


def test_a_frame_that_cannot_be_graded_has_no_apples() -> None:
    loop = GradingLoop(ScriptedCamera(frame(1), frame(2, 0), frame(5)), grading, SteppedClock())
    assert loop.step(1.0).apples == (APPLE,) and loop.status.working
    assert loop.step(1.0).apples is None
    assert not loop.status.working and loop.status.message == "the picture is black"
    assert loop.status.values["apples"] == "0"
    assert loop.step(1.0).apples == (APPLE,) and loop.status.values["lost_frames"] == "2"


def test_a_lost_camera_is_opened_again_after_a_second() -> None:
    clock = SteppedClock()
    camera = ScriptedCamera(
        CameraSilent("nothing"), CameraLost("gone"), frame(1), opening=(None, CameraBusy("in use by cheese"))
    )
    loop = GradingLoop(camera, grading, clock)
    assert loop.step(1.0) is None and loop.status.message == "nothing" and camera.closed == 0
    assert loop.step(1.0) is None and loop.status.message == "gone" and camera.closed == 1
    messages, start_s = [], clock.time_s
    while (seen := loop.step(0.5)) is None:
        messages.append(loop.status.message)
        assert clock.time_s < start_s + 5.0
    assert "in use by cheese" in messages and seen.apples == (APPLE,)
    assert clock.time_s >= start_s + 2.0 and loop.status.values["reopened"] == "1"


def test_the_end_of_a_recording_ends_the_grading() -> None:
    camera = ScriptedCamera(frame(1), SourceEnded("the recording has ended"))
    loop = GradingLoop(camera, grading, SteppedClock())
    loop.step(1.0)
    assert loop.step(1.0) is None and loop.ended
    assert [loop.step(1.0) for _ in range(5)] == [None] * 5 and camera.opened == 1
    assert loop.status.message == "the recording has ended"


def test_the_annotated_picture_is_a_copy_with_a_box() -> None:
    picture = np.full((480, 640, 3), 90, np.uint8)
    drawn = annotated(picture, [APPLE])
    assert (picture == 90).all() and tuple(drawn[32, 300]) == (20, 200, 60)
