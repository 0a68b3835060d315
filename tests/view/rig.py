"""A simulated arm that is looked at, without a file, a socket or a browser."""

from collections.abc import Iterator, Sequence

from servoloop.recording.mcap_messages import Received
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.sampler import CycleSample
from tests.recorder.rig import Rig


def received(rig: Rig, samples: Sequence[CycleSample]) -> Iterator[Received]:
    """What a feed has of these cycles."""
    for number, sample in enumerate(samples):
        for one in rig.messages.of_cycle(sample):
            yield Received(one.topic, one.stamp_ns, one.message, number)


def watched(rig: Rig) -> ObservedRobot:
    """All that the stack has done so far, looked at."""
    found = ObservedRobot()
    for one in rig.messages.latched(0.0):
        found.take(Received(one.topic, one.stamp_ns, one.message, 0))
    for message in received(rig, rig.samples):
        found.take(message)
    return found
