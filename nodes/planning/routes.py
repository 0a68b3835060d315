"""Controllers of a stack, and the joints that they move. This module does not import any ROS package."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["trajectory", "gripper", "parallel_gripper", "forward"]


@dataclass(frozen=True, slots=True)
class Route:
    """A controller and its joints, in the controller's order."""

    name: str
    kind: Kind
    joints: tuple[str, ...]
