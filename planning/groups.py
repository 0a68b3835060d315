"""Joint groups, end effectors and named states of an arm, as in MoveIt's SRDF files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from hal.robot_description.description import Description, UrdfJoint
from hal.types import AT_LIMIT
from planning.planning_errors import PlanningError

ARM: Final = "arm"
"""Name of the derived group that contains the joints that move the tool."""
HAND: Final = "hand"
"""Name of the derived group that contains all other joints, and of the group's end effector."""

States = Mapping[str, Mapping[str, float]]
"""Joint positions keyed by state and joint name, in rad or m."""


@dataclass(frozen=True, slots=True)
class Group:
    """Joints that are planned together."""

    name: str
    joints: tuple[str, ...]
    """Joints with independent positions: all joints except fixed, passive and mimic joints."""
    tip: str | None = None
    """Last link of the group if the group's joints form a chain, otherwise the link that carries the group's end
    effector."""
    states: States = field(default_factory=dict)
    """Named states."""

    def state(self, name: str) -> Mapping[str, float]:
        """Return the positions of a named state, keyed by joint name, in rad or m. Raises PlanningError."""
        if name not in self.states:
            known = f"choose one of {', '.join(self.states)}" if self.states else "the group has no named states"
            raise PlanningError("INVALID_GOAL_CONSTRAINTS", f"the group {self.name} has no state named {name}: {known}")
        return self.states[name]


@dataclass(frozen=True, slots=True)
class EndEffector:
    """A hand at the end of an arm."""

    name: str
    group: str
    """Joint group of the hand."""
    parent_link: str
    """Link of the arm that carries the hand."""
    parent_group: str = ""
    """Group of the arm. Empty if the SRDF does not specify the group."""


@dataclass(frozen=True, slots=True)
class Groups:
    """Groups and end effectors of one robot, keyed by name."""

    groups: Mapping[str, Group]
    end_effectors: Mapping[str, EndEffector]

    def group(self, name: str) -> Group:
        """Return the group with this name. Raises PlanningError."""
        if name not in self.groups:
            known = ", ".join(self.groups)
            raise PlanningError("INVALID_GROUP_NAME", f"there is no group {name}: choose one of {known}")
        return self.groups[name]


def derive_groups(description: Description, driven: Sequence[str], tool: str, states: States) -> Groups:
    """Derive the groups of an arm that has no SRDF.

    Args:
        description: Robot description.
        driven: Names of the driven joints.
        tool: Link that carries the hand. The driven joints between the base and this link form the group ``arm``,
            and the others form the group ``hand``.
        states: Poses of the arm, keyed by name. A pose that contains joints of both groups becomes a state of each
            group.

    Raises:
        PlanningError: A name is not in the description, no joint moves the tool, or a position is outside its limits.
    """
    for name in driven:
        if name not in description.joints:
            known = ", ".join(description.joints)
            raise PlanningError("INVALID_ROBOT_STATE", f"the URDF has no joint {name}: choose from {known}")
    path = [joint.name for joint in path_to(description, tool)]
    members = {
        ARM: tuple(name for name in path if name in driven),
        HAND: tuple(name for name in driven if name not in path),
    }
    if not members[ARM]:
        known = ", ".join(description.joints[name].child for name in driven)
        raise PlanningError(
            "INVALID_LINK_NAME", f"no driven joint moves the tool {tool}: choose a link such as {known}"
        )
    _check_states(description, driven, states)
    tips = {ARM: tool, HAND: None}
    groups = {
        name: Group(name, joints, tips[name], _states_of(joints, states)) for name, joints in members.items() if joints
    }
    return Groups(groups, {HAND: EndEffector(HAND, HAND, tool, ARM)} if HAND in groups else {})


def _states_of(joints: Sequence[str], states: States) -> States:
    """Return the states that contain positions for all of these joints, reduced to these joints."""
    return {
        name: {joint: positions[joint] for joint in joints}
        for name, positions in states.items()
        if all(joint in positions for joint in joints)
    }


def _check_states(description: Description, driven: Sequence[str], states: States) -> None:
    for state, positions in states.items():
        for name, position in positions.items():
            if name not in driven:
                raise PlanningError(
                    "INVALID_ROBOT_STATE", f"in state {state}, {name} is not driven: choose from {', '.join(driven)}"
                )
            if problem := outside(description.joints[name], position):
                raise PlanningError("INVALID_ROBOT_STATE", f"in state {state}, {problem}: correct the position")


def outside(joint: UrdfJoint, position: float) -> str:
    """Describe a position outside a joint's limits, or return an empty string if the position is within them."""
    slack = AT_LIMIT * (joint.upper - joint.lower)
    if joint.kind == "continuous" or joint.lower - slack <= position <= joint.upper + slack:
        return ""
    return f"{joint.name} is at {position:g}, outside its limits {joint.lower:g} to {joint.upper:g}"


def path_to(description: Description, link: str, base: str | None = None) -> list[UrdfJoint]:
    """Return the joints from the base to a link, including fixed joints.

    Args:
        description: Robot description.
        link: Name of the last link.
        base: Name of the first link. By default, this is the root.

    Raises:
        PlanningError: A link does not exist, or ``base`` is not between the root and the link.
    """
    for name in (link, base):
        if name is not None and name not in description.links:
            known = ", ".join(description.links)
            raise PlanningError("INVALID_LINK_NAME", f"the URDF has no link {name}: choose one of {known}")
    joints = list(_joints_above(description, link))
    if base is not None and base != link:
        parents = [joint.parent for joint in joints]
        if base not in parents:
            raise PlanningError(
                "INVALID_LINK_NAME", f"{link} does not descend from {base}: swap the links or choose other links"
            )
        joints = joints[: parents.index(base) + 1]
    return [] if base == link else joints[::-1]


def _joints_above(description: Description, link: str) -> Iterator[UrdfJoint]:
    """Yield the joints from a link up to the root."""
    above = {joint.child: joint for joint in description.joints.values()}
    while link in above:
        yield above[link]
        link = above[link].parent
