"""Name of the controller manager, of which only one may run in each namespace. This module does not import any ROS
package."""

from typing import Final

MANAGER: Final = "controller_manager"
"""Name of the controller manager's node."""
OTHER: Final = (
    "another node is named {}, so a client's goal would move the arms of both stacks: stop the other stack, or choose "
    "another --namespace or another ROS_DOMAIN_ID for this stack"
)
"""Message to use if another controller manager, whose name replaces the braces, is in the ROS graph."""
