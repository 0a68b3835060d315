"""A simulated arm whose state is observed without a file, a socket or a browser."""

from collections.abc import Iterator, Sequence

from servoloop.recording.mcap_messages import Received
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.sampler import CycleSample
from tests.recorder.rig import Rig
from tests.stack.rig import READY


def received(rig: Rig, samples: Sequence[CycleSample]) -> Iterator[Received]:
    """Yield the messages that a feed sends for these cycles."""
    for number, sample in enumerate(samples):
        for one in rig.messages.of_cycle(sample):
            yield Received(one.topic, one.stamp_ns, one.message, number)


def watched(rig: Rig) -> ObservedRobot:
    """Return the observed state after all cycles that the stack has run so far."""
    found = ObservedRobot()
    for one in rig.messages.latched(0.0):
        found.take(Received(one.topic, one.stamp_ns, one.message, 0))
    for message in received(rig, rig.samples):
        found.take(message)
    return found


def moved_rig() -> Rig:
    """Return a stack that has moved joint1 to 0.2 rad."""
    rig = Rig()
    rig.run(1.0)
    rig.stack.go([0.2, *READY[1:]], 1.0)
    rig.run(2.5)
    return rig
