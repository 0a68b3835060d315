"""Check the joint commands from another program and sort them into joint order."""

from collections.abc import Collection, Sequence

import numpy as np

from hal.types import FloatArray


class RefusedCommandError(ValueError):
    """A message is not a valid command for this arm. The error message tells the user what to correct."""


class JointCommands:
    """Commands for n joints, received in messages that contain the joint names.

    ros2_control's plugin for topics lists every joint of its ``<ros2_control>`` block, but sends positions only for
    joints that have a position command interface.
    """

    def __init__(self, joints: Sequence[str], others: Collection[str] = ()) -> None:
        """Create a checker for the commands of ``joints``.

        Messages may also contain ``others``, which are joints that cannot be commanded, such as mimic joints.
        """
        self.joints = tuple(joints)
        self._others = frozenset(others)

    def sorted(self, names: Sequence[str], positions: Sequence[float]) -> FloatArray:
        """Return the commands (n,) of one message, in rad or m. NaN indicates a joint without a command.

        ros2_control sends NaN for joints that no controller commands.

        Args:
            names: Names of the joints in the message.
            positions: Positions of these joints, or only of the joints that this arm can move.

        Raises:
            RefusedCommandError: The message contains wrong names, a wrong number of positions or an infinite value.
        """
        if not len(positions):
            raise RefusedCommandError(
                "the command has no positions: in <ros2_control>, declare a position command interface for each joint"
            )
        commanded = list(names) if len(names) == len(positions) else [name for name in names if name in self.joints]
        if len(commanded) != len(positions):
            raise RefusedCommandError(
                f"the command has {len(positions)} positions for {len(names)} joints, and this arm moves "
                f"{len(commanded)} of these joints: send one position for each of {', '.join(self.joints)}"
            )
        self._check_names(commanded)
        given = dict(zip(commanded, positions, strict=True))
        infinite = [name for name, value in given.items() if np.isinf(value)]
        if infinite:
            raise RefusedCommandError(f"the command for {', '.join(infinite)} is infinite: send a position in rad or m")
        return np.array([given.get(joint, np.nan) for joint in self.joints], dtype=np.float64)

    def _check_names(self, names: Sequence[str]) -> None:
        if unknown := [name for name in names if name not in self.joints and name not in self._others]:
            raise RefusedCommandError(
                f"the command contains {', '.join(unknown)}, but this arm moves {', '.join(self.joints)}: use the same "
                "joint names on both sides"
            )
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise RefusedCommandError(f"the command contains {', '.join(twice)} twice: list each joint once")
