"""Tree of an arm's links, with the link poses and the tool pose at given joint positions."""

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
"""Number of points drawn between two consecutive points of a goal."""


class DrawnArm:
    """Links of a robot description. Joint positions are in the order of the measured joints."""

    def __init__(self, joints: Mapping[str, UrdfJoint], measured: Sequence[str]) -> None:
        self._joints = joints
        self.measured = tuple(measured)
        self._above = {joint.child: joint for joint in joints.values()}
        self._poses = LinkPoses(joints, measured)
        parents = [joint.parent for joint in joints.values()]
        self.links = tuple(dict.fromkeys([*parents, *self._above]))

    @property
    def reach_m(self) -> float:
        """Length of the longest chain of joints, in meters."""
        return max(map(self._chain_m, self.links))

    def _chain_m(self, link: str) -> float:
        joint = self._above.get(link)
        return 0.0 if joint is None else math.hypot(*joint.xyz_m) + self._chain_m(joint.parent)

    def branch(self, link: str) -> str:
        """Return the path of a link in the tree, such as ``/base_link/link1``."""
        joint = self._above.get(link)
        return f"{self.branch(joint.parent) if joint else ''}/{link}"

    def joint_of(self, link: str) -> str | None:
        """Return the measured joint that moves a link, or None if there is none. A mimic joint is treated as the joint
        that it follows."""
        joint = self._above.get(link)
        while joint is not None:
            if joint.name in self.measured:
                return joint.name
            if joint.mimic is not None:
                return joint.mimic.joint if joint.mimic.joint in self.measured else None
            joint = self._above.get(joint.parent) if joint.kind == "fixed" else None
        return None

    def fixed(self) -> Iterator[LinkPose]:
        """Yield the poses of the links that are fixed to their parents."""
        return iter(self._poses.fixed)

    def moving(self, position: FloatArray) -> Iterator[LinkPose]:
        """Yield the poses of the moving links at joint positions (n,), in rad or m.

        A link is omitted if the position of its joint is NaN.
        """
        return self._poses.moving(position)

    def tool_link(self, joints: Sequence[str]) -> str:
        """Return the last link of the chain: the child of the last of these joints, or the last link fixed to that
        child."""
        depths = {self._joints[name].child: self.branch(self._joints[name].child).count("/") for name in joints}
        link = max(depths, key=lambda child: depths[child])
        while after := [j.child for j in self._joints.values() if j.parent == link and j.kind == "fixed"]:
            link = after[0]
        return link

    def pose(self, link: str, position: FloatArray) -> tuple[Vector, Quaternion]:
        """Return the pose of a link in the root link's frame, in meters, at joint positions (n,) in rad or m."""
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
        """Return the position (m) of a link in the root link's frame, at joint positions (n,) in rad or m."""
        return self.pose(link, position)[0]

    def path(self, joints: Sequence[str], points: FloatArray, start: FloatArray | None) -> FloatArray:
        """Return the path of the tool (m, 3) through a goal's points, in meters.

        Between two points, the joint positions are interpolated linearly. The real motion differs slightly, because it
        respects the acceleration and jerk limits of each joint.

        Args:
            joints: Joints of the goal.
            points: Points of the goal (k, joints), in rad or m.
            start: Positions of all measured joints (n,) at the start, or None to start at the first point.
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
