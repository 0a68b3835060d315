"""A simulated run in a recording's file, under simulated time."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from drivers.port import Port
from hal.types import JointState
from servoloop.files import servo_ids
from servoloop.recorder.bus_tap import BusTaps
from servoloop.recorder.sampler import Sampler
from servoloop.simulation.stack import SimulatedStack


@contextmanager
def recorded(stack: SimulatedStack, path: Path) -> Iterator[None]:
    """Record all cycles of the block into a new file, from before the stack is up. Raises RecordingError."""
    from servoloop.recorder.link_poses import scene_poses
    from servoloop.recorder.messages import Messages  # takes a tenth of a second, which most runs save
    from servoloop.recorder.recording_file import RecordingFile

    files, loop, taps = stack.files, stack.loop, BusTaps()
    sampler = Sampler(loop, files.component.name, servo_ids(files), taps)
    hardware = loop.hardware
    file = RecordingFile(path, Messages(files.description, hardware.joints, hardware.command_interfaces, 0.0))
    look_on = stack.on_state

    def tap(port: Port) -> Port:
        return taps.tap(port, stack.clock)

    def on_state(state: JointState) -> None:
        look_on(state)
        file.write(replace(sampler.sample(state), scene=scene_poses(stack.scene)))

    stack.tap, stack.on_state = tap, on_state
    try:
        yield
    finally:
        stack.on_state = look_on
        file.close(taps.take())
