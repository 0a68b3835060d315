"""Name the topics between the arm and another controller manager."""

from dataclasses import dataclass

STATES = "robot_joint_states"
"""Default topic of the states in ros2_control's JointStateTopicSystem."""
COMMANDS = "robot_joint_commands"
"""Default topic of the commands in ros2_control's JointStateTopicSystem."""


@dataclass(frozen=True, slots=True)
class HostTopics:
    """Topics of an arm under another controller manager."""

    states: str = STATES
    """Topic on which the arm publishes its joint states."""
    commands: str = COMMANDS
    """Topic on which the arm receives joint commands."""
