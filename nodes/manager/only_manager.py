"""Name of the controller manager, of which only one may run in a namespace. Imports no ROS package."""

from typing import Final

MANAGER: Final = "controller_manager"
"""Name of the node of the controller manager."""
OTHER: Final = (
    "another node is named {}, so a client's goal would move the arms of both stacks: end the other stack, or choose "
    "another --namespace or another ROS_DOMAIN_ID for this one"
)
"""Message if another controller manager with the name in the braces is in the ROS graph."""
