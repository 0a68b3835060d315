"""Copy the settings of the ``arm`` and ``hand`` groups to the groups of a robot with several arms."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from planning.groups import ARM, HAND
from servoloop.motion_planning.robot import arm_groups, planning_robot
from servoloop.stack.robot_files import Files

KINEMATICS: Final = "kinematics.yaml"
PLANNERS: Final = "ompl_planning.yaml"
RVIZ: Final = "moveit.rviz"
RVIZ_GROUP: Final = "Planning Group: "


@dataclass(frozen=True, slots=True)
class GroupNames:
    """Group names of a robot with several arms."""

    chains: tuple[str, ...]
    """Groups of a single arm, for which MoveIt computes inverse kinematics."""
    arms: tuple[str, ...]
    """Groups that contain one or more arms."""
    hands: tuple[str, ...]
    """Groups that contain the hands."""


def group_names(files: Files) -> GroupNames:
    """Return the group names in a robot's SRDF. Raises HalError or PlanningError."""
    robot = planning_robot(files)
    arms = arm_groups(robot, files)
    names = tuple(group.name for group in arms)
    hands = tuple(name for name in robot.groups.groups if name not in names)
    return GroupNames(tuple(group.name for group in arms if group.tip is not None), names, hands)


def group_settings(folder: Path, names: GroupNames) -> dict[str, str]:
    """Return the contents of the group settings files in ``folder``, rewritten for these groups."""
    kinematics, planners = ((folder / name).read_text() for name in (KINEMATICS, PLANNERS))
    rviz = (folder / RVIZ).read_text().replace(f"{RVIZ_GROUP}{ARM}\n", f"{RVIZ_GROUP}{names.chains[0]}\n")
    planners = _repeated(_repeated(planners, ARM, names.arms), HAND, names.hands)
    return {KINEMATICS: _repeated(kinematics, ARM, names.chains), PLANNERS: planners, RVIZ: rviz}


def _repeated(text: str, group: str, names: Sequence[str]) -> str:
    """Return the text with one copy of a group's section for each name. Only the first copy includes comments."""
    section = re.search(rf"^{group}:\n((?:[ ]+.*\n)+)", text, re.MULTILINE)
    assert section is not None
    plain = re.sub(r"^ +#.*\n", "", section[1], flags=re.MULTILINE)
    copies = "".join(f"{name}:\n{plain if number else section[1]}" for number, name in enumerate(names))
    return text[: section.start()] + copies + text[section.end() :]
