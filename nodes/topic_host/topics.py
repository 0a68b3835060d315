"""Name the node of an arm under another controller manager, and its topics. Imports no ROS package."""

from dataclasses import dataclass
from typing import Final

NAME: Final = "servoloop_topic_host"
"""Name of the node of the arm."""
OTHER: Final = (
    "another node is named {}, so the commands of ros2_control would move the arms of both: end the other topic-host, "
    "or choose another --namespace or another ROS_DOMAIN_ID for this one"
)
"""Message if another node with the name in the braces is in the ROS graph."""
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
