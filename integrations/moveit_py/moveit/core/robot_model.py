"""Model of a robot: its groups, joints and named states, from its URDF and SRDF."""

from typing import Any

import numpy as np

from hal.robot_description.description import parse_urdf
from hal.robot_description.urdf import UrdfJoint
from hal.robot_description.xml_places import parse_xml
from planning.groups import Group
from planning.srdf_file import parse_srdf


class JointModelGroup:
    """Group of joints that are planned together. Mimic joints are omitted."""

    def __init__(self, group: Group, joints: list[UrdfJoint], eef_name: str) -> None:
        self._group = group
        self._joints = joints
        self._eef_name = eef_name

    @property
    def name(self) -> str:
        """Name of the group."""
        return self._group.name

    @property
    def joint_model_names(self) -> list[str]:
        """Names of the joints."""
        return list(self._group.joints)

    @property
    def active_joint_model_names(self) -> list[str]:
        """Names of the active joints, which are all joints of the group."""
        return list(self._group.joints)

    @property
    def link_model_names(self) -> list[str]:
        """Names of the links that the joints move directly."""
        return [joint.child for joint in self._joints]

    @property
    def eef_name(self) -> str:
        """Name of the end effector that this group represents; empty if the group is not an end effector."""
        return self._eef_name

    @property
    def states(self) -> dict[str, dict[str, float]]:
        """Named states, with positions (rad or m) keyed by joint name."""
        return {name: dict(positions) for name, positions in self._group.states.items()}

    @property
    def tip(self) -> str | None:
        """Last link of the group if the group is a chain."""
        return self._group.tip

    def satisfies_position_bounds(self, values: Any, margin: float = 0.0) -> bool:
        """Return whether positions (n,) are within the limits of the joints, extended by ``margin`` (rad or m)."""
        bounds = np.array([(joint.lower - margin, joint.upper + margin) for joint in self._joints])
        positions = np.asarray(values, dtype=float)
        return bool(np.all((positions >= bounds[:, 0]) & (positions <= bounds[:, 1])))


class RobotModel:
    """Groups, joints and named states of a robot.

    ``client`` is the move_group client with which states of this model compute kinematics; None without a client.
    """

    def __init__(self, urdf: str, srdf: str, client: Any = None) -> None:
        self._description = parse_urdf(urdf)
        self._groups = parse_srdf(srdf, self._description)
        self._name = parse_xml(urdf, "the URDF").get("name", "")
        self.client = client
        children = {joint.child for joint in self._description.joints.values()}
        self._root = next(link for link in self._description.links if link not in children)

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self._name

    @property
    def model_frame(self) -> str:
        """Frame of the model, which is that of its root link."""
        return self._root

    @property
    def root_joint_name(self) -> str:
        """Name of the joint between the world and the root link, as MoveIt names it."""
        return "ASSUMED_FIXED_ROOT_JOINT"

    @property
    def joint_model_group_names(self) -> list[str]:
        """Names of the groups."""
        return list(self._groups.groups)

    @property
    def joint_model_groups(self) -> list[JointModelGroup]:
        """All groups."""
        return [self.get_joint_model_group(name) for name in self._groups.groups]

    @property
    def end_effectors(self) -> list[JointModelGroup]:
        """Groups that are end effectors."""
        return [self.get_joint_model_group(effector.group) for effector in self._groups.end_effectors.values()]

    @property
    def joints(self) -> dict[str, UrdfJoint]:
        """All joints except fixed joints and mimic joints, keyed by name."""
        joints = self._description.joints.values()
        return {joint.name: joint for joint in joints if joint.kind != "fixed" and joint.mimic is None}

    def has_joint_model_group(self, joint_model_group_name: str) -> bool:
        """Return whether there is a group with this name."""
        return joint_model_group_name in self._groups.groups

    def get_joint_model_group(self, joint_model_group_name: str) -> JointModelGroup:
        """Return a group. Raises PlanningError, whose message lists all groups, if no group has this name."""
        group = self._groups.group(joint_model_group_name)
        joints = [self._description.joints[name] for name in group.joints]
        effectors = self._groups.end_effectors.values()
        return JointModelGroup(group, joints, next((e.name for e in effectors if e.group == group.name), ""))

    def get_model_info(self) -> str:
        """Describe the groups and their joints."""
        groups = (f"{name}: {', '.join(group.joints)}" for name, group in self._groups.groups.items())
        return "\n".join((f"model {self.name} in frame {self.model_frame}", *groups))
