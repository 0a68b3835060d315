"""The feed next to the emulated bus delivers the latest publication first and never blocks the emulator."""

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from drivers.driver_errors import PortBusy, PortError
from sim_backend.scene.world_feed import PERIOD_S, WorldFeed, WorldFeedClient, feed_path


@dataclass(frozen=True)
class StillPose:
    position_m: tuple[float, float, float] = (0.1, 0.2, 0.3)
    quaternion_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class StillApple:
    seed: int = 7
    diameter_mm: float = 55.0


class StillWorld:
    """A world with a cube in a bin that never changes."""

    apple: StillApple | None = None

    joints = ("joint1", "hand")
    time_s = 0.0

    def position(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array([0.5, 0.01])

    def poses(self) -> dict[str, StillPose]:
        return {"cube": StillPose()}

    def cube_bins(self) -> dict[str, str | None]:
        return {"cube": "A"}

    def arm_contacts(self) -> set[str]:
        return {"link5 and stand"}


@pytest.fixture
def feed(tmp_path: Path) -> Iterator[WorldFeed]:
    with WorldFeed(feed_path(tmp_path / "bus")) as feed:
        yield feed


def publish(feed: WorldFeed, world: StillWorld, times: int = 1) -> None:
    for _ in range(times):
        world.time_s += 1.0
        feed.tick(world.time_s, world, 0.25)


def test_a_publication_contains_poses_and_joints(feed: WorldFeed) -> None:
    client, world = WorldFeedClient(feed.path), StillWorld()
    publish(feed, world)
    assert client.newest() == {
        "time_s": 1.0,
        "poses": {"cube": {"position_m": [0.1, 0.2, 0.3], "quaternion_xyzw": [0, 0, 0, 1]}},
        "cube_bins": {"cube": "A"},
        "joints": {"joint1": 0.5, "hand": 0.01},
        "dropped_s": 0.25,
        "trace": [],
        "contacts": [],
    }
    assert client.newest() is None
    client.close()


def test_a_world_with_apples_publishes_the_apple(feed: WorldFeed) -> None:
    world = StillWorld()
    with closing(WorldFeedClient(feed.path)) as client:
        publish(feed, world)
        world.apple = StillApple()
        publish(feed, world)
        first, second = client.all()[-2:]
    assert "apple" not in first
    assert second["apple"] == {"seed": 7, "diameter_mm": 55.0}


def test_the_trace_has_joint_positions_since_the_last_publication(feed: WorldFeed) -> None:
    client, world = WorldFeedClient(feed.path), StillWorld()
    publish(feed, world)
    for now_s in (1.01, 1.02, 2.0):
        feed.tick(now_s, world, 0.0)
    assert [p["trace"] for p in client.all()] == [[], [[1.01, [0.5, 0.01]], [1.02, [0.5, 0.01]], [2.0, [0.5, 0.01]]]]
    client.close()


def test_contacts_since_the_last_publication_are_published_once(feed: WorldFeed) -> None:
    client, world = WorldFeedClient(feed.path), StillWorld()
    publish(feed, world)
    for now_s in (1.01, 2.0):
        feed.tick(now_s, world, 0.0)
    assert [p["contacts"] for p in client.all()] == [[], ["link5 and stand"]]
    client.close()


def test_only_the_latest_publication_is_returned(feed: WorldFeed) -> None:
    client, world = WorldFeedClient(feed.path), StillWorld()
    publish(feed, world, 5)
    newest = client.newest()
    assert newest is not None
    assert newest["time_s"] == 5.0
    client.close()


def test_nothing_is_published_between_two_periods(feed: WorldFeed) -> None:
    client, world = WorldFeedClient(feed.path), StillWorld()
    feed.tick(1.0, world, 0.0)
    feed.tick(1.0 + PERIOD_S / 4, world, 0.0)
    assert client.newest() is not None
    assert client.newest() is None
    client.close()


def test_only_a_client_that_does_not_read_is_disconnected(feed: WorldFeed) -> None:
    slow, fast, world = WorldFeedClient(feed.path), WorldFeedClient(feed.path), StillWorld()
    for _ in range(5000):
        publish(feed, world)
        assert fast.newest() is not None
    while not slow.ended:
        slow.newest()
    assert not fast.ended
    fast.close()


def test_a_disconnected_client_does_not_affect_others(feed: WorldFeed) -> None:
    WorldFeedClient(feed.path).close()
    publish(feed, StillWorld(), 3)


def test_a_line_in_two_parts_is_joined(feed: WorldFeed) -> None:
    client = WorldFeedClient(feed.path)
    feed._accept()
    line = json.dumps({"time_s": 1.0}).encode() + b"\n"
    feed._clients[0].send(line[:5])
    assert client.newest() is None
    feed._clients[0].send(line[5:])
    assert client.newest() == {"time_s": 1.0}
    client.close()


def test_the_client_notices_the_end(tmp_path: Path) -> None:
    with WorldFeed(tmp_path / "bus.world") as feed:
        client = WorldFeedClient(feed.path)
        feed.tick(0.0, StillWorld(), 0.0)
    client.newest()
    assert client.ended
    assert not feed.path.exists()
    with pytest.raises(OSError, match="No such file"):
        WorldFeedClient(feed.path)
    client.close()


def test_a_second_feed_is_refused_and_a_stale_socket_is_removed(feed: WorldFeed) -> None:
    with pytest.raises(PortBusy, match="another emulator"):
        WorldFeed(feed.path)
    feed._socket.close()  # a killed program leaves its socket behind
    WorldFeed(feed.path).close()


def test_a_file_in_the_way_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "bus.world"
    path.write_text("mine")
    with pytest.raises(PortBusy, match="not an emulator's socket"):
        WorldFeed(path)
    assert path.read_text() == "mine"


def test_a_path_that_is_too_long_for_a_socket_is_reported_with_the_remedy(tmp_path: Path) -> None:
    """Without a path from the user, the path is in the temporary folder."""
    with pytest.raises(PortError, match=r"bus.world: AF_UNIX path too long: choose a shorter path, or .* TMPDIR"):
        WorldFeed(feed_path(tmp_path / ("x" * 100) / "bus"))


def test_clients_do_not_wait_for_an_emulator_that_hangs(tmp_path: Path) -> None:
    """The queue of an emulator that hangs is full."""
    path = feed_path(tmp_path / "bus")
    with ExitStack() as ends:
        server = ends.enter_context(socket.socket(socket.AF_UNIX))
        server.bind(str(path))
        server.listen(0)
        first = ends.enter_context(socket.socket(socket.AF_UNIX))
        first.connect(str(path))
        with pytest.raises(OSError):
            WorldFeedClient(path)
        with pytest.raises(PortBusy, match="is served by another emulator"):
            WorldFeed(path)
