"""Names for the node and the topics of an arm that another controller manager drives. Imports no ROS package."""

from dataclasses import dataclass
from typing import Final

NAME: Final = "servoloop_topic_host"
"""Name of the arm's node."""
OTHER: Final = (
    "another node is named {}, so the commands of ros2_control would move the arms of both nodes: stop the other "
    "topic-host, or choose another --namespace or another ROS_DOMAIN_ID for this topic-host"
)
"""Message to show if the ROS graph contains another node with the same name. The braces are replaced by that name."""
STATES = "robot_joint_states"
"""Default state topic of ros2_control's JointStateTopicSystem."""
COMMANDS = "robot_joint_commands"
"""Default command topic of ros2_control's JointStateTopicSystem."""


@dataclass(frozen=True, slots=True)
class HostTopics:
    """Topics of an arm that another controller manager drives."""

    states: str = STATES
    """Topic on which the arm publishes its joint states."""
    commands: str = COMMANDS
    """Topic on which the arm receives joint commands."""
