"""Convert the constraints of requests to goals and path constraints."""

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Final

import numpy as np
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped
from moveit_msgs.msg import BoundingVolume, Constraints, JointConstraint, OrientationConstraint, PositionConstraint
from shape_msgs.msg import SolidPrimitive

from nodes.planning.conversion.frames import Frames
from nodes.planning.conversion.poses import pose_of, quaternion_of, tool_pose, vector_of
from nodes.planning.request_errors import RequestError
from planning.constraints import LinkRegion, PathConstraints
from planning.kinematics.goals import Angles, PoseGoal, PositionBox, PositionSphere, checked_pose
from planning.motion import Goal, JointGoal, ToolGoal
from planning.planning_errors import PlanningError
from planning.robot import PlanningRobot
from planning.scene import Pose

FREE_RAD: Final = math.pi
"""Minimum tolerance at which an orientation is considered free, in rad."""
ANYWHERE_M: Final = 900.0
"""Radius of the position region if a constraint has no position, in m."""
SMALLEST_M: Final = 1e-4
"""Radius or length that replaces 0 in a position region, in m."""
SMALLEST_RAD: Final = 1e-3
"""Tolerance that replaces 0 in an orientation constraint, in rad."""

Region = tuple[Pose, PositionSphere | PositionBox]
"""A position region and its center in the planning frame."""


class ConstraintReader:
    """Reader of constraints. Poses are converted with the frames of one robot state."""

    def __init__(self, robot: PlanningRobot, frames: Frames, tip: str | None) -> None:
        self._robot = robot
        self._frames = frames
        self.tip = tip
        """Tip of the group. Constraints without a link apply to the tip of the group."""

    def goals(self, message: Constraints) -> list[Goal]:
        """Return goals, each of which satisfies the constraints.

        Raises:
            RequestError, PlanningError: The constraints are invalid, or of a type that the planner does not support.
        """
        _check_kind(message)
        if not message.joint_constraints:
            return [self._tool_goal(*one) for one in self._regions(message)]
        if message.position_constraints or message.orientation_constraints:
            raise _invalid("a goal has both joint positions and a pose of a link: send only one of them")
        return [JointGoal(*self._joints(message.joint_constraints))]

    def path(self, message: Constraints) -> PathConstraints:
        """Return the constraints of a path. Raises RequestError or PlanningError."""
        _check_kind(message)
        positions, around = self._joints(message.joint_constraints)
        ranges = {joint: (at - around[joint][0], at + around[joint][1]) for joint, at in positions.items()}
        regions = []
        for position in message.position_constraints:
            goals = [self._tool_goal(region, position, None) for region in self._position_regions(position)]
            if len(goals) > 1:
                raise _invalid("a path constraint has a region with several shapes: send only one shape")
            regions += [LinkRegion(goal.goal, goal.link, goal.offset) for goal in goals]
        for orientation in message.orientation_constraints:
            goal = self._tool_goal(_anywhere(), None, orientation)
            regions.append(LinkRegion(goal.goal, goal.link, goal.offset))
        return PathConstraints(ranges, regions)

    def pose_goal(self, message: PoseStamped, link: str, position_m: float, turn_rad: float) -> ToolGoal:
        """Return the goal that moves a link to a pose within tolerances. Raises RequestError or PlanningError."""
        pose = self._frames.in_base(message.header.frame_id) @ self.goal_pose(message.pose)
        return ToolGoal(
            PoseGoal(tool_pose(pose), PositionSphere(position_m), (turn_rad,) * 3), *self.planned_frame(link or None)
        )

    def goal_pose(self, message: PoseMessage) -> Pose:
        """Return the pose of a goal. Raises RequestError if the pose is not finite or its quaternion is not
        normalized."""
        return _goal_pose(message)

    def planned_frame(self, name: str | None) -> tuple[str | None, Pose]:
        """Return the link to plan for, and the pose of a frame relative to this link.

        Args:
            name: A link, an attached object or a subframe of an attached object. None means the tip of the group.

        Raises:
            RequestError: The frame does not exist.
        """
        if name is None or name in self._robot.links:
            return name, Pose()
        point = self._frames.point(name)
        if point is None:
            known = ", ".join((*self._robot.links, *self._frames.held))
            raise RequestError("INVALID_LINK_NAME", f'there is no link "{name}": choose one of {known}')
        return point.link, point.pose

    def _joints(
        self, constraints: Sequence[JointConstraint]
    ) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
        """Return positions and tolerances, keyed by joint name."""
        positions, tolerances = dict[str, float](), dict[str, tuple[float, float]]()
        for one in constraints:
            name = one.joint_name
            joint = self._robot.description.joints.get(name)
            if joint is None or (name not in self._robot.limits and joint.mimic is None):
                raise _invalid(f'there is no joint "{name}": choose one of {", ".join(self._robot.limits)}')
            if joint.mimic is not None and name not in self._robot.limits:
                continue  # This joint mimics another joint of the goal.
            for what, value in (("tolerance_below", one.tolerance_below), ("tolerance_above", one.tolerance_above)):
                if not 0.0 <= value < math.inf:
                    raise _invalid(f"{what} of {name} is {value}: send a finite number, 0 or more")
            if not math.isfinite(one.position):
                raise _invalid(f"the position of {name} is {one.position}: send a finite number")
            positions[name], tolerances[name] = one.position, (one.tolerance_below, one.tolerance_above)
        return positions, tolerances

    def _regions(
        self, message: Constraints
    ) -> Iterator[tuple[Region, PositionConstraint | None, OrientationConstraint | None]]:
        """Yield each combination of a position region and an orientation."""
        positions, orientations = message.position_constraints, message.orientation_constraints
        if len(positions) > 1 or len(orientations) > 1:
            raise _invalid("a goal has more than one pose: send the pose of one link, or send several goals")
        if not positions and not orientations:
            raise _invalid("a goal has no constraint: send joint positions or a pose")
        regions = self._position_regions(positions[0]) if positions else [_anywhere()]
        yield from product(regions, positions or [None], orientations or [None])

    def _tool_goal(
        self, region: Region, position: PositionConstraint | None, orientation: OrientationConstraint | None
    ) -> ToolGoal:
        names = {one.link_name for one in (position, orientation) if one is not None and one.link_name}
        if len(names) > 1:
            raise _invalid(f"a goal has poses of the links {' and '.join(sorted(names))}: send the pose of one link")
        name = next(iter(names), self.tip)
        offset_m = vector_of(position.target_point_offset) if position is not None else (0.0, 0.0, 0.0)
        if not all(map(math.isfinite, offset_m)):
            raise _invalid(f"the offset {offset_m} of a position is not finite: send numbers")
        turned, tolerance_rad, angles = self._orientation(orientation)
        center, volume = region
        link, frame = self.planned_frame(name)
        target = tool_pose(Pose(center.position_m, turned.matrix))
        return ToolGoal(PoseGoal(target, volume, tolerance_rad, angles), link, frame @ Pose(np.array(offset_m)))

    def _orientation(self, message: OrientationConstraint | None) -> tuple[Pose, tuple[float, float, float], Angles]:
        """Return the orientation in the planning frame, its tolerances in rad and the parameterization of the
        tolerances."""
        if message is None:
            return Pose(), (FREE_RAD, FREE_RAD, FREE_RAD), "rotation_vector"
        checked = checked_pose((0.0, 0.0, 0.0), quaternion_of(message.orientation))
        turned = Pose.from_quaternion((0.0, 0.0, 0.0), checked.quaternion_xyzw.tolist())
        x, y, z = (
            _tolerance(value, SMALLEST_RAD)
            for value in (
                message.absolute_x_axis_tolerance,
                message.absolute_y_axis_tolerance,
                message.absolute_z_axis_tolerance,
            )
        )
        is_vector = message.parameterization == OrientationConstraint.ROTATION_VECTOR
        frame = self._frames.in_base(message.header.frame_id)
        return frame @ turned, (x, y, z), "rotation_vector" if is_vector else "xyz_euler"

    def _position_regions(self, message: PositionConstraint) -> list[Region]:
        volume: BoundingVolume = message.constraint_region
        if volume.meshes:
            raise _invalid(f"the region of {message.link_name} has a mesh: use a box, a sphere or a cylinder")
        if not volume.primitives or len(volume.primitives) != len(volume.primitive_poses):
            raise _invalid(f"the region of {message.link_name} needs at least one shape and a pose for each shape")
        frame = self._frames.in_base(message.header.frame_id)
        return [
            _region(shape, frame @ _goal_pose(pose))
            for shape, pose in zip(volume.primitives, volume.primitive_poses, strict=True)
        ]


def _region(shape: SolidPrimitive, center: Pose) -> Region:
    sizes = [_tolerance(size, SMALLEST_M) for size in shape.dimensions]
    kind, count = shape.type, len(sizes)
    if kind == SolidPrimitive.SPHERE and count == 1:
        return center, PositionSphere(sizes[0])
    if kind == SolidPrimitive.CYLINDER and count == 2:  # The cylinder is replaced by a box that fits inside it.
        side_m = sizes[1] * math.sqrt(2.0)
        return center, PositionBox((side_m, side_m, sizes[0]), _quaternion(center))
    if kind == SolidPrimitive.BOX and count == 3:
        return center, PositionBox((sizes[0], sizes[1], sizes[2]), _quaternion(center))
    raise _invalid(f"a region has a shape of type {kind} with {count} dimensions: use a box, a sphere or a cylinder")


def _anywhere() -> Region:
    return Pose(), PositionSphere(ANYWHERE_M)


def _goal_pose(message: PoseMessage) -> Pose:
    try:
        return pose_of(message)
    except PlanningError as error:
        raise _invalid(f"the goal's {error}") from None


def _quaternion(pose: Pose) -> tuple[float, float, float, float]:
    x, y, z, w = tool_pose(pose).quaternion_xyzw.tolist()
    return x, y, z, w


def _tolerance(value: float, smallest: float) -> float:
    """Return a size, raised to the smallest allowed size if necessary. Raises RequestError if the size is negative or
    not finite."""
    if not 0.0 <= value < math.inf:
        raise _invalid(f"a tolerance of the goal is {value}: send a finite number, 0 or more")
    return max(float(value), smallest)


def _check_kind(message: Constraints) -> None:
    if message.visibility_constraints:
        raise RequestError("UNRECOGNIZED_GOAL_TYPE", "visibility constraints are not supported: send a pose")


def _invalid(message: str) -> RequestError:
    return RequestError("INVALID_GOAL_CONSTRAINTS", message)
