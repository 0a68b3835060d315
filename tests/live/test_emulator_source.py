"""Display of a virtual arm without a stack, from the joint positions published by the emulator."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hal.robot_description.description import parse_urdf
from servoloop.recording.emulator_source import AGAIN_S, EmulatorSource
from servoloop.recording.stream import LiveError
from servoloop.stack.arm_folders import find_arm, read_arm_files
from sim_backend.clock import SimulatedClock
from sim_backend.scene.world import World
from sim_backend.scene.world_feed import WorldFeed, feed_path

FILES = read_arm_files(find_arm("so101"))
DESCRIPTION = parse_urdf(find_arm("so101").urdf.read_text())


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "bus"


@pytest.fixture
def world() -> World:
    return World(FILES.scene)


@pytest.fixture
def feed(link: Path) -> Iterator[WorldFeed]:
    with WorldFeed(feed_path(link)) as feed:
        yield feed


def test_joints_and_cube_are_at_the_published_positions(link: Path, world: World, feed: WorldFeed) -> None:
    source = EmulatorSource(link, DESCRIPTION, SimulatedClock())
    assert source.up_to_date and source.status == f"{link}: virtual servos"
    for now_s in (0.0, 1.0):
        feed.tick(now_s, world, 0.0)
    snapshot = source.robot.state.snapshot
    assert snapshot.joints == world.joints and snapshot.description_xml == DESCRIPTION.xml
    np.testing.assert_allclose(snapshot.position, world.position())
    assert snapshot.scene["cube"].position_m == pytest.approx(world.poses()["cube"].position_m)
    source.close()


def test_source_reconnects_to_a_restarted_emulator(link: Path, world: World) -> None:
    clock = SimulatedClock()
    with WorldFeed(feed_path(link)) as feed:
        source = EmulatorSource(link, DESCRIPTION, clock)
        feed.tick(0.0, world, 0.0)
        assert source.robot.state.snapshot.joints
    before = source.robot
    assert not source.up_to_date and source.status == f"{link}: the emulator has stopped"
    with WorldFeed(feed_path(link)) as feed:
        assert source.robot is before, "it looks again a second later"
        clock.sleep_until(clock.now() + AGAIN_S)
        assert source.robot is not before and source.up_to_date
        feed.tick(0.0, world, 0.0)
        assert source.robot.state.snapshot.joints
    source.close()


def test_error_without_emulator_explains_how_to_start_one(link: Path) -> None:
    with pytest.raises(
        LiveError, match=rf"no virtual arm is running at {link}: start the arm with `servoloop emulate {link}`"
    ):
        EmulatorSource(link, DESCRIPTION, SimulatedClock())
