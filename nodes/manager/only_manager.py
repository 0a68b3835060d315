"""Name of the controller manager, of which only one may run in a namespace. Imports no ROS package."""

from typing import Final

MANAGER: Final = "controller_manager"
"""Name of the controller manager's node."""
OTHER: Final = (
    "another node is named {}, so a client's goal would move the arms of both stacks: stop the other stack, or choose "
    "another --namespace or another ROS_DOMAIN_ID for this stack"
)
"""Message if another controller manager with the name in the braces is in the ROS graph."""
