"""Stand-in for ros2_control's JointStateTopicSystem, written according to the source code of version 1.1."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

THRESHOLD: float = 1e-5
"""If the sum of the distances between states and commands does not exceed this value, the plugin sends nothing."""


@dataclass(frozen=True, slots=True)
class Message:
    """The fields of a sensor_msgs/JointState that the plugin fills."""

    name: tuple[str, ...]
    position: tuple[float, ...]


@dataclass
class TopicSystem:
    """The plugin before its first state, with its joints in the order of its ``<ros2_control>`` block."""

    joints: Sequence[str]
    passive: Sequence[str] = ()
    """Joints without a command interface. Messages contain the names of these joints, but no positions for them."""
    states: dict[str, float] = field(default_factory=dict)
    commands: dict[str, float] = field(default_factory=dict)
    """Commands of the controllers, in rad. The command of a joint without an active controller is NaN."""

    def read(self, names: Sequence[str], positions: Sequence[float]) -> None:
        """Store the values of a state message. Joints of other components and values that are not finite are
        skipped."""
        for name, position in zip(names, positions, strict=True):
            if name in (*self.joints, *self.passive) and math.isfinite(position):
                self.states[name] = position

    def write(self) -> Message | None:
        """Return the message of one cycle, or None if all joints are at their commands."""
        commands = [self.commands.get(joint, math.nan) for joint in self.joints]
        differences = [abs(self.states.get(j, math.nan) - c) for j, c in zip(self.joints, commands, strict=True)]
        if sum(differences) <= THRESHOLD:  # false for NaN: with a joint that has no command, the plugin always sends
            return None
        return Message((*self.joints, *self.passive), tuple(commands))
