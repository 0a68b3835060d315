"""Stand-in for ros2_control's JointStateTopicSystem, written from what its source does in version 1.1."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

THRESHOLD: float = 1e-5
"""Sum of the distances between states and commands up to which the plug-in sends nothing."""


@dataclass(frozen=True, slots=True)
class Message:
    """The fields of a sensor_msgs/JointState that the plug-in fills."""

    name: tuple[str, ...]
    position: tuple[float, ...]


@dataclass
class TopicSystem:
    """The plug-in with its joints in the order of its ``<ros2_control>`` block, before its first state."""

    joints: Sequence[str]
    passive: Sequence[str] = ()
    """Joints without a command interface. Messages name them, but have no position for them."""
    states: dict[str, float] = field(default_factory=dict)
    commands: dict[str, float] = field(default_factory=dict)
    """Commands of the controllers, in rad. A joint that no controller commands has NaN."""

    def read(self, names: Sequence[str], positions: Sequence[float]) -> None:
        """Take over a state message. Joints of other components and values that are not finite are skipped."""
        for name, position in zip(names, positions, strict=True):
            if name in (*self.joints, *self.passive) and math.isfinite(position):
                self.states[name] = position

    def write(self) -> Message | None:
        """Return the message of one cycle, or None if all states are at their commands."""
        commands = [self.commands.get(joint, math.nan) for joint in self.joints]
        differences = [abs(self.states.get(j, math.nan) - c) for j, c in zip(self.joints, commands, strict=True)]
        if sum(differences) <= THRESHOLD:  # false for NaN: a joint without a command makes the plug-in send always
            return None
        return Message((*self.joints, *self.passive), tuple(commands))
