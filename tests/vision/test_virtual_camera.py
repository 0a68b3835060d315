"""The virtual camera as a camera source that reads the feed of a world, in simulated time."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from perception.frames import CameraSource
from perception.grading.grader import Grader
from perception.perception_errors import CameraLost, CameraMissing, CameraSilent
from servoloop.stack.arm_folders import find_arm
from servoloop.virtual_camera import VirtualCamera
from sim_backend.scene.world import World
from sim_backend.scene.world_feed import WorldFeed, feed_path


class WorldClock:
    """A clock that publishes the world every 0.01 s while it sleeps."""

    def __init__(self, link: Path, world: World) -> None:
        self.feed, self.world, self.runs = WorldFeed(feed_path(link)), world, True
        self.now_s = 100.0

    def now(self) -> float:
        return self.now_s

    def sleep_until(self, deadline_s: float) -> None:
        while self.now_s < deadline_s:
            self.now_s = min(self.now_s + 0.01, deadline_s)
            if self.runs:
                self.feed.tick(self.now_s, self.world, 0.0)


@pytest.fixture(params=["robot_arm", "so101"])
def arm(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def clock(tmp_path: Path, arm: str) -> Iterator[WorldClock]:
    world = World(find_arm(arm).scene, apples=1)
    world._place_arm(world.ready)
    made = WorldClock(tmp_path / "bus", world)
    yield made
    made.feed.close()


@pytest.fixture
def camera(tmp_path: Path, arm: str, clock: WorldClock) -> Iterator[VirtualCamera]:
    made = VirtualCamera(tmp_path / "bus", find_arm(arm).scene, clock)
    yield made
    made.close()


def test_it_is_a_camera_source(camera: VirtualCamera, clock: WorldClock) -> None:
    source: CameraSource = camera
    source.open()
    frames = [source.read(1.0) for _ in range(12)]
    assert [frame.number for frame in frames] == list(range(1, 13))
    assert frames[0].size == (640, 480)
    assert np.diff([frame.stamp_s for frame in frames]) == pytest.approx(0.1, abs=0.06)
    assert source.rate_hz == pytest.approx(10.0, rel=0.15)


@pytest.mark.parametrize("arm", ["robot_arm"], indirect=True)
def test_a_picture_shows_the_present_state_at_any_time(camera: VirtualCamera, clock: WorldClock) -> None:
    camera.open()
    for wait_s in (0.11, 0.12, 0.13, 0.14, 0.15, 0.16):
        clock.sleep_until(clock.now_s + wait_s)
        frame = camera.read(1.0)
        assert clock.now_s - frame.stamp_s < 0.03


def test_the_grader_agrees_with_the_truth(camera: VirtualCamera, clock: WorldClock) -> None:
    camera.open()
    grader = Grader(camera.view, camera.settings)
    for _ in range(3):
        (apple,) = grader.grade(camera.read(1.0).rgb)
        truth = camera.truth()
        assert truth is not None
        assert apple.diameter_mm == pytest.approx(truth.diameter_mm, abs=3.0)
        assert apple.red_ratio == pytest.approx(truth.red_ratio, abs=0.06)
        assert apple.defect_score == pytest.approx(truth.defect_score, abs=0.06)
        np.testing.assert_allclose(apple.position_m, truth.position_m, atol=0.006)
        clock.world.cell.feed_cube()
        clock.sleep_until(clock.now_s + 0.1)


@pytest.mark.parametrize("arm", ["robot_arm"], indirect=True)
def test_every_end_is_reported(camera: VirtualCamera, clock: WorldClock) -> None:
    with pytest.raises(CameraLost, match="not open"):
        camera.read(0.1)
    camera.open()
    camera.read(1.0)
    clock.runs = False
    with pytest.raises(CameraSilent, match=r"for 0\.5 s"):
        camera.read(0.5)
    clock.runs = True
    assert camera.read(1.0).number == 2
    clock.runs = False
    clock.feed.close()
    with pytest.raises(CameraLost, match="start the emulator again"):
        for _ in range(3):
            camera.read(0.2)
    camera.close()
    with pytest.raises(CameraMissing, match="start the emulator first"):
        camera.open()
