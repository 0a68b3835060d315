"""The recordings of ``servoloop up``: a file where it is asked for, those of faults, and the feed of who looks on."""

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from controller.loop import ControlLoop
from drivers.clock import Clock
from drivers.port import Port
from hal.types import JointState
from servoloop.files import Files, servo_ids
from servoloop.live.errors import LiveError
from servoloop.live.feed import LiveFeed
from servoloop.live.folder import make_live_folder, socket_path
from servoloop.recorder.bus_tap import BusTaps
from servoloop.recorder.fault_files import FOLDER, FaultFiles
from servoloop.recorder.link_poses import Scene
from servoloop.recorder.messages import Messages
from servoloop.recorder.recorder import Recorder, Sink
from servoloop.recorder.recording_file import RecordingFile
from servoloop.recorder.sampler import Sampler

LOG = logging.getLogger("servoloop")


class StackRecording:
    """The recording of one stack. Its taps are there first: a line is opened before the loop runs."""

    def __init__(self, path: Path | None) -> None:
        """``path``: of the file, None to keep only faults."""
        self._path = path
        self._taps = BusTaps()

    def tap(self, port: Port, clock: Clock) -> Port:
        """The port, with a tap."""
        return self._taps.tap(port, clock)

    @contextmanager
    def of(
        self, loop: ControlLoop, files: Files, offset_s: float, failed: Callable[[], bool], scene: Scene = dict
    ) -> Iterator[None]:
        """Record what the loop does while the context lasts, behind its other observers.

        ``offset_s``: from the loop's clock to ROS time; ``failed`` is asked in the end; ``scene`` in the recorder's
        thread. Raises RecordingError.
        """
        hardware, shown = loop.hardware, loop.on_cycle
        messages = Messages(files.description, hardware.joints, hardware.command_interfaces, offset_s)
        sinks: list[Sink] = [FaultFiles(FOLDER, messages)]
        if self._path is not None:
            sinks.append(RecordingFile(self._path, messages))
        sinks += _live_feed(files, messages)
        sampler = Sampler(loop, files.component.name, servo_ids(files), self._taps)
        recorder = Recorder(sampler, self._taps, sinks, scene)

        def on_cycle(state: JointState) -> None:
            shown(state)
            recorder.post(state)

        loop.on_cycle = on_cycle
        recorder.start()
        try:
            yield
        finally:
            recorder.close(failed())


def _live_feed(files: Files, messages: Messages) -> list[Sink]:
    """The feed of those who look on; an arm without one works as well."""
    try:
        make_live_folder()
        return [LiveFeed(socket_path(files.arm, os.getpid()), messages, files.folder)]
    except LiveError as error:
        LOG.warning("%s", error)
        return []
