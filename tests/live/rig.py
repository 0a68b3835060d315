"""Live feed of a simulated stack on a socket, with viewers."""

import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pytest import MonkeyPatch

from servoloop.recording.feed import LiveFeed
from servoloop.recording.robot_state import ReportedState
from servoloop.recording.stream import MessageStream, make_live_folder, socket_path
from tests.recorder.rig import Rig
from tests.servoloop.served import eventually


@contextmanager
def runtime_folder(monkeypatch: MonkeyPatch) -> Iterator[Path]:
    """Return a separate folder for sockets of running stacks. The path of the folder is short, because the length of
    socket paths is limited."""
    with tempfile.TemporaryDirectory(prefix="live") as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield Path(folder)


class LiveRig(Rig):
    """Active stack with its feed. ``play`` sends the cycles of the stack to the feed."""

    def __init__(self, arm: str = "robot_arm", pid: int = 1, folder: Path | None = None) -> None:
        """``folder`` is the folder of the arm, if the stack publishes it."""
        super().__init__()
        make_live_folder()
        self.feed = LiveFeed(socket_path(arm, pid), self.messages, folder)

    def play(self, seconds: float) -> int:
        """Run for a given time, and return the number of cycles."""
        samples = self.run(seconds)
        for sample in samples:
            self.feed.write(sample)
            self.feed.flush()
        return len(samples)

    def wait_until_read(self) -> None:
        """Wait until all viewers have received all cycles."""
        eventually(lambda: self.feed.flush() or not any(viewer._waiting for viewer in self.feed._viewers))


class LiveViewer:
    """Program that receives the feed in a separate thread."""

    def __init__(self, stream: MessageStream) -> None:
        self.state = ReportedState()
        self._stream = stream
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        for received in self._stream:
            self.state.take(received)

    def to_its_end(self) -> ReportedState:
        """Return the robot state at the end of the stream."""
        self._thread.join(30.0)
        assert not self._thread.is_alive()
        return self.state
