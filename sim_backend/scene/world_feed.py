"""Poses of the virtual arm and its surroundings, as a camera would see them, published on a Unix socket next to the
bus.

The control stack accesses the arm only over the bus. This feed serves images, transforms and tests. Each client
receives one JSON line per publication, and is disconnected if it reads too slowly.
"""

import contextlib
import json
import socket
import threading
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from drivers.driver_errors import PortBusy, PortError
from hal.robot_description.description import Vector
from hal.robot_description.kinematics import Quaternion

PERIOD_S: Final = 0.05
CONNECT_S: Final = 2.0
"""Maximum time to connect, in seconds. Without this limit, a client would wait forever if an emulator hangs and its
connection queue is full."""
SEND_BUFFER_BYTES: Final = 1 << 20
"""Size of the send buffer, in bytes. If a client does not read, the buffer holds the publications of about ten
seconds."""

Pose = tuple[Vector, Quaternion]
"""Position in meters, and orientation as a quaternion x, y, z, w."""


class SeenPose(Protocol):
    """Position (m) and orientation (unit quaternion) in base_link."""

    @property
    def position_m(self) -> tuple[float, float, float]: ...

    @property
    def quaternion_xyzw(self) -> tuple[float, float, float, float]: ...


class ArrivingApple(Protocol):
    """Apple that is being sorted."""

    @property
    def seed(self) -> int: ...

    @property
    def diameter_mm(self) -> float: ...


class SeenWorld(Protocol):
    """The part of ``sim_backend.scene.world.World`` that the feed uses."""

    @property
    def joints(self) -> tuple[str, ...]: ...

    @property
    def time_s(self) -> float: ...

    def position(self) -> NDArray[np.float64]: ...

    def poses(self) -> Mapping[str, SeenPose]: ...

    def cube_bins(self) -> Mapping[str, str | None]: ...

    def arm_contacts(self) -> set[str]: ...

    @property
    def apple(self) -> ArrivingApple | None: ...


def feed_path(link: Path) -> Path:
    """Return the feed path for the bus at ``link``."""
    return link.with_name(link.name + ".world")


def snapshot(
    world: SeenWorld, dropped_s: float, trace: Sequence[Any] = (), contacts: Collection[str] = ()
) -> dict[str, Any]:
    """Return one publication: world time, poses, bins of the cubes, joint positions (rad, m), and time lost to stalls.

    A world with apples also publishes the apple's seed and diameter. The apple's pose and bin replace the cube's.
    ``trace`` contains the joint motion since the last publication, as pairs of a time on the emulator's clock (s) and
    the positions in the order of ``joints``. This clock is the same for all processes on a computer. ``contacts``
    contains the arm's contacts since the last publication, except for those with the cube.
    """
    apple = world.apple
    return {
        **({} if apple is None else {"apple": {"seed": apple.seed, "diameter_mm": apple.diameter_mm}}),
        "time_s": round(world.time_s, 6),
        "poses": {
            name: {"position_m": pose.position_m, "quaternion_xyzw": pose.quaternion_xyzw}
            for name, pose in world.poses().items()
        },
        "cube_bins": dict(world.cube_bins()),
        "joints": dict(zip(world.joints, world.position().tolist(), strict=True)),
        "dropped_s": round(dropped_s, 6),
        "trace": list(trace),
        "contacts": sorted(contacts),
    }


class WorldFeed:
    """Context manager for the server of the world feed. Call ``tick`` in the emulator's loop; it never blocks."""

    def __init__(self, path: Path) -> None:
        """Listen at ``path``. Raises PortBusy if another emulator serves the path, and PortError if the path cannot be
        used."""
        self.path = path
        self._clients: list[socket.socket] = []
        self._next_s = 0.0
        self._trace: list[tuple[float, list[float]]] = []
        self._contacts: set[str] = set()
        self._socket = listening(path)

    def tick(self, now_s: float, world: SeenWorld, dropped_s: float) -> None:
        """Record the joint positions and contacts, and publish them if a publication is due."""
        if self._clients:
            self._trace.append((round(now_s, 6), world.position().round(6).tolist()))
            self._contacts |= world.arm_contacts()
        if now_s < self._next_s:
            return
        # Keep the publication period, unless a publication was missed.
        self._next_s = max(self._next_s + PERIOD_S, now_s + 0.5 * PERIOD_S)
        self._accept()
        if self._clients:
            line = json.dumps(snapshot(world, dropped_s, self._trace, self._contacts)).encode() + b"\n"
            self._trace, self._contacts = [], set()
            self._clients = [client for client in self._clients if _sent(client, line)]

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                client, _ = self._socket.accept()
                client.setblocking(False)
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
                self._clients.append(client)

    def close(self) -> None:
        """Disconnect all clients and remove the socket."""
        for end in (*self._clients, self._socket):
            end.close()
        self.path.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _sent(client: socket.socket, line: bytes) -> bool:
    """Send a line and return whether it was sent completely. If the line was not sent completely, the client is slow or
    has disconnected, and its connection is closed."""
    with contextlib.suppress(OSError):
        if client.send(line) == len(line):
            return True
    client.close()
    return False


TOO_LONG: Final = "choose a shorter path, or set TMPDIR to a shorter path if this path is in the temporary folder"
"""Remedy for a path that is too long for a socket. Python reports this error without a number."""


def listening(path: Path) -> socket.socket:
    """Return a non-blocking socket that listens on ``path``. Raises PortBusy if another emulator serves the path, or
    PortError if the path cannot be used."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    made.setblocking(False)
    try:
        _remove_remains(path)
        made.bind(str(path))
    except OSError as error:
        made.close()
        remedy = "choose another path" if error.errno else TOO_LONG
        raise PortError(f"cannot serve at {path}: {error.strerror or error}: {remedy}") from error
    except PortError:
        made.close()
        raise
    made.listen()
    return made


def _remove_remains(path: Path) -> None:
    """Remove the socket of an emulator that has exited. Files of any other type are left unchanged."""
    if not path.exists() and not path.is_symlink():
        return
    if not path.is_socket():
        raise PortBusy(f"{path} exists and is not an emulator's socket: choose another path")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe, contextlib.suppress(BlockingIOError, TimeoutError):
        probe.settimeout(CONNECT_S)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return
    raise PortBusy(f"{path} is served by another emulator: stop that emulator, or choose another path")


class WorldFeedClient:
    """Client that reads the latest publication without waiting. ``ended`` becomes True after the emulator has
    disconnected."""

    def __init__(self, path: Path) -> None:
        """Connect to the feed at ``path``. Raises OSError if there is no emulator at this path, or if the emulator
        hangs."""
        self.ended = False
        self._rest = b""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(CONNECT_S)
        try:
            self._socket.connect(str(path))
        except OSError:
            self._socket.close()
            raise
        self._socket.setblocking(False)

    def newest(self) -> dict[str, Any] | None:
        """Return the latest complete publication since the last call; None if there is none."""
        lines = self._lines()
        return dict(json.loads(lines[-1])) if lines else None

    def all(self) -> list[dict[str, Any]]:
        """Return every complete publication since the last call, oldest first."""
        return [dict(json.loads(line)) for line in self._lines()]

    def _lines(self) -> list[bytes]:
        *lines, self._rest = (self._rest + self._received()).split(b"\n")
        return lines

    def _received(self) -> bytes:
        chunks: list[bytes] = []
        while not self.ended:
            try:
                chunk = self._socket.recv(65536)
            except BlockingIOError:
                break
            except OSError:
                chunk = b""
            chunks.append(chunk)
            self.ended = not chunk
        return b"".join(chunks)

    def close(self) -> None:
        """Disconnect. A second call has no effect."""
        self.ended = True
        self._socket.close()


class EmulatedScene:
    """Latest poses published by an emulator. All methods are safe to call from any thread."""

    def __init__(self, client: WorldFeedClient) -> None:
        self._client = client
        self._poses: dict[str, Pose] = {}
        self._lock = threading.Lock()

    def __call__(self) -> Mapping[str, Pose]:
        """Return the poses, keyed by name. The mapping is empty before the first publication."""
        with self._lock:
            newest = self._client.newest()
            if newest is not None:
                self._poses = {
                    name: (tuple(pose["position_m"]), tuple(pose["quaternion_xyzw"]))
                    for name, pose in newest["poses"].items()
                }
            return self._poses
