"""The arm as a tree of links: where each one is drawn, and where the tool is for given joint positions."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from hal.robot_description.description import UrdfJoint, Vector
from hal.robot_description.kinematics import Quaternion, child_pose, multiply, rotate
from hal.types import FloatArray
from servoloop.recording.sampler import LinkPose, LinkPoses

HERE: tuple[Vector, Quaternion] = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
BETWEEN = 16
"""Points of a drawn path between two points of a goal."""


class ArmModel:
    """The links of a robot description; joints are in the order of the measurements."""

    def __init__(self, joints: Mapping[str, UrdfJoint], measured: Sequence[str]) -> None:
        self._joints = joints
        self.measured = tuple(measured)
        self._above = {joint.child: joint for joint in joints.values()}
        self._poses = LinkPoses(joints, measured)
        parents = [joint.parent for joint in joints.values()]
        self.links = tuple(dict.fromkeys([*parents, *self._above]))

    @property
    def reach_m(self) -> float:
        """The length of the longest chain of joints, in meters."""
        return max(map(self._away, self.links))

    def _away(self, link: str) -> float:
        joint = self._above.get(link)
        return 0.0 if joint is None else math.hypot(*joint.xyz_m) + self._away(joint.parent)

    def branch(self, link: str) -> str:
        """A link's place in the tree, from the root on: ``/base_link/link1``."""
        joint = self._above.get(link)
        return f"{self.branch(joint.parent) if joint else ''}/{link}"

    def joint_of(self, link: str) -> str | None:
        """The measured joint that moves this link, of a mimic joint the one that it follows; None where none does."""
        joint = self._above.get(link)
        while joint is not None:
            if joint.name in self.measured:
                return joint.name
            if joint.mimic is not None:
                return joint.mimic.joint
            joint = self._above.get(joint.parent) if joint.kind == "fixed" else None
        return None

    def fixed(self) -> Iterator[LinkPose]:
        """The poses of the links that never move in their parents."""
        return iter(self._poses.fixed)

    def moving(self, position: FloatArray) -> Iterator[LinkPose]:
        """The poses of the others at joint positions (n,) in rad or m; a link whose joint is NaN is left out."""
        return self._poses.moving(position)

    def tool_link(self, joints: Sequence[str]) -> str:
        """The link behind the last of these joints and what is fixed to it."""
        depths = {self._joints[name].child: self.branch(self._joints[name].child).count("/") for name in joints}
        link = max(depths, key=lambda child: depths[child])
        while after := [j.child for j in self._joints.values() if j.parent == link and j.kind == "fixed"]:
            link = after[0]
        return link

    def pose(self, link: str, position: FloatArray) -> tuple[Vector, Quaternion]:
        """The pose (m) of a link in the root link at joint positions (n,) in rad or m."""
        found = {pose.child: (pose.position_m, pose.quaternion) for pose in self._poses.fixed}
        found |= {pose.child: (pose.position_m, pose.quaternion) for pose in self._poses.moving(position)}
        (x, y, z), turn = HERE
        chain = []
        while (joint := self._above.get(link)) is not None:
            chain.append(found.get(link) or child_pose(joint, 0.0))
            link = joint.parent
        for shift, turned in reversed(chain):
            a, b, c = rotate(turn, shift)
            x, y, z, turn = x + a, y + b, z + c, multiply(turn, turned)
        return (x, y, z), turn

    def place(self, link: str, position: FloatArray) -> Vector:
        """The place (m) of a link in the root link at joint positions (n,) in rad or m."""
        return self.pose(link, position)[0]

    def path(self, joints: Sequence[str], points: FloatArray, start: FloatArray | None) -> FloatArray:
        """The way (m, 3) of the tool in metres through a goal's points (k, joints), from the positions ``start`` (n,).

        Without ``start`` it begins at the goal's first point.

        Between two points the joints go in proportion to each other. The real motion differs from that a little: it
        keeps within the limits of each joint's acceleration and jerk.
        """
        columns = [self.measured.index(name) for name in joints]
        rows = np.tile(np.zeros(len(self.measured)) if start is None else np.nan_to_num(start), (len(points) + 1, 1))
        rows[1:, columns] = points
        if start is None:
            rows = rows[1:]
        share = np.linspace(0.0, 1.0, BETWEEN, endpoint=False)[:, None]
        pieces = [first + share * (second - first) for first, second in pairwise(rows)]
        tool = self.tool_link(joints)
        return np.array([self.place(tool, row) for row in np.concatenate([*pieces, rows[-1:]])])
