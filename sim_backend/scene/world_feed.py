"""What a camera over the virtual arm would see, on a Unix socket beside the bus. For watchers only.

The control stack's way to the arm is the wire; this is the other one, for pictures, transforms and
tests. Each client gets one JSON line a publication, or is dropped if it does not keep up.
"""

import contextlib
import json
import socket
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from drivers.errors import PortBusy, PortError

PERIOD_S: Final = 0.05
CONNECT_S: Final = 2.0
"""An emulator that hangs accepts nobody, and when its queue is full a client would wait for it for ever."""
SEND_BUFFER_BYTES: Final = 1 << 20
"""Some ten seconds of publications: so long a client may look away."""


class SeenPose(Protocol):
    """Position (m) and orientation (unit quaternion) in base_link."""

    @property
    def position_m(self) -> tuple[float, float, float]: ...

    @property
    def quaternion_xyzw(self) -> tuple[float, float, float, float]: ...


class SeenWorld(Protocol):
    """What the feed needs of ``sim_backend.scene.world.World``."""

    @property
    def joints(self) -> tuple[str, ...]: ...

    @property
    def time_s(self) -> float: ...

    def position(self) -> NDArray[np.float64]: ...

    def poses(self) -> Mapping[str, SeenPose]: ...

    def cube_bin(self) -> str | None: ...


def feed_path(link: Path) -> Path:
    """Where the feed of the bus at ``link`` is."""
    return link.with_name(link.name + ".world")


def snapshot(world: SeenWorld, dropped_s: float, trace: Sequence[Any] = ()) -> dict[str, Any]:
    """One publication: world time, poses, the cube's bin, joints (rad, m), time lost to stalls.

    ``trace`` is what the joints did since the last one: pairs of the emulator's clock (s; on one
    machine every process reads the same) and the positions in the order of ``joints``.
    """
    return {
        "time_s": round(world.time_s, 6),
        "poses": {
            name: {"position_m": pose.position_m, "quaternion_xyzw": pose.quaternion_xyzw}
            for name, pose in world.poses().items()
        },
        "cube_bin": world.cube_bin(),
        "joints": dict(zip(world.joints, world.position().tolist(), strict=True)),
        "dropped_s": round(dropped_s, 6),
        "trace": list(trace),
    }


class WorldFeed:
    """The server side; a context manager. ``tick`` belongs in the emulator's loop, never blocks."""

    def __init__(self, path: Path) -> None:
        """Listen at ``path``. Raises PortBusy if another emulator does, PortError where nobody can."""
        self.path = path
        self._clients: list[socket.socket] = []
        self._next_s = 0.0
        self._trace: list[tuple[float, list[float]]] = []
        self._socket = listening(path)

    def tick(self, now_s: float, world: SeenWorld, dropped_s: float) -> None:
        """Note where the joints are, and publish if it is time to."""
        if self._clients:
            self._trace.append((round(now_s, 6), world.position().round(6).tolist()))
        if now_s < self._next_s:
            return
        # On the beat, unless a beat was missed.
        self._next_s = max(self._next_s + PERIOD_S, now_s + 0.5 * PERIOD_S)
        self._accept()
        if self._clients:
            line = json.dumps(snapshot(world, dropped_s, self._trace)).encode() + b"\n"
            self._trace = []
            self._clients = [client for client in self._clients if _sent(client, line)]

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                client, _ = self._socket.accept()
                client.setblocking(False)
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
                self._clients.append(client)

    def close(self) -> None:
        """Send everybody away and remove the socket."""
        for end in (*self._clients, self._socket):
            end.close()
        self.path.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _sent(client: socket.socket, line: bytes) -> bool:
    """Whether the whole line went out. Otherwise the client is slow or gone, and is closed."""
    with contextlib.suppress(OSError):
        if client.send(line) == len(line):
            return True
    client.close()
    return False


def listening(path: Path) -> socket.socket:
    """A socket that listens at ``path`` and never blocks. Raises PortBusy if an emulator does, PortError."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    made.setblocking(False)
    try:
        _remove_remains(path)
        made.bind(str(path))
    except OSError as error:
        made.close()
        raise PortError(f"cannot serve at {path}: {error.strerror or error}: choose another path") from error
    except PortError:
        made.close()
        raise
    made.listen()
    return made


def _remove_remains(path: Path) -> None:
    """Remove the socket of an ended emulator; leave everything else alone."""
    if not path.exists() and not path.is_symlink():
        return
    if not path.is_socket():
        raise PortBusy(f"{path} exists and is no emulator's socket: choose another path")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe, contextlib.suppress(BlockingIOError, TimeoutError):
        probe.settimeout(CONNECT_S)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return
    raise PortBusy(f"{path} is served by another emulator: end it, or choose another path")


class WorldFeedClient:
    """Reads the newest publication without waiting. ``ended`` once the emulator is gone."""

    def __init__(self, path: Path) -> None:
        """Connect to the feed at ``path``. Raises OSError if nobody serves it, or somebody who hangs."""
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
        """The newest complete publication since the last call; None if there is none."""
        lines = self._lines()
        return dict(json.loads(lines[-1])) if lines else None

    def all(self) -> list[dict[str, Any]]:
        """Every complete publication since the last call, the oldest first."""
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
        """Hang up. Closing twice is no error."""
        self.ended = True
        self._socket.close()
