"""Convert client requests to computations on a robot and one planning scene. No function in this module communicates
over ROS."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Final

from geometry_msgs.msg import PoseStamped
from moveit_msgs.msg import ContactInformation, MotionPlanRequest, PositionIKRequest, RobotState
from moveit_msgs.srv import GetCartesianPath, GetPositionFK, GetStateValidity
from std_msgs.msg import Header

from nodes.planning.conversion.constraints import ConstraintReader
from nodes.planning.conversion.evaluation import ConstraintChecks, Evaluation
from nodes.planning.conversion.frames import Frames
from nodes.planning.conversion.poses import pose_message, tool_pose
from nodes.planning.request_errors import RequestError
from nodes.planning.slowing import slowed
from nodes.planning.states import state_of, world_of
from nodes.planning.world import PlanningWorld
from planning.collision import Margins
from planning.constraints import PathConstraints
from planning.group_planner import GroupPlanner
from planning.kinematics.cartesian import Steps
from planning.kinematics.goals import CollidingError
from planning.motion import LineMotion, LineRequest, Motion, MotionRequest, Scaling, State, Validity
from planning.robot import PlanningRobot
from planning.scene import Pose

PIPELINE: Final = "ompl"
"""Name of the only planning pipeline."""
DEFAULT_TIME_S: Final = 5.0
"""Default time limit of a request, in seconds."""
LONGEST_TIME_S: Final = 60.0
"""Maximum time limit of a request, in seconds."""
MOST_SEARCHES: Final = 5
"""Maximum number of searches for a request, regardless of the number of attempts requested."""
SLOWEST: Final = 1e-3
"""Minimum scaling factor."""
IK_POSITION_M: Final = 1e-4
"""Position tolerance of an inverse kinematics request, in m."""
IK_TURN_RAD: Final = 1e-3
"""Orientation tolerance of an inverse kinematics request, in rad."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The planning scene and the measured state at the time a request arrived."""

    world: PlanningWorld
    state: State


@dataclass(frozen=True, slots=True)
class Planned:
    """A planned motion."""

    motion: Motion
    start: State
    group: str
    seconds: float
    """Time spent on planning, in seconds."""


class Requests:
    """Object that computes responses and never changes its own state. Only one thread at a time may call ``motion``."""

    def __init__(self, robot: PlanningRobot) -> None:
        self.robot = robot

    def time_limit_s(self, request: MotionPlanRequest) -> float:
        """Return the time limit of a request, in seconds. Raises RequestError if the time limit is not a number."""
        limit_s = request.allowed_planning_time
        if math.isnan(limit_s):
            raise RequestError("PLANNING_FAILED", "allowed_planning_time is NaN: send a time in seconds")
        return min(limit_s, LONGEST_TIME_S) if limit_s > 0.0 else DEFAULT_TIME_S

    def motion(self, request: MotionPlanRequest, now: Snapshot, remaining_s: Callable[[], float]) -> Planned:
        """Plan a motion. Raises RequestError or PlanningError."""
        begun_s = remaining_s()
        if request.pipeline_id not in ("", PIPELINE):
            raise RequestError("FAILURE", f"there is no planning pipeline {request.pipeline_id}: use {PIPELINE}")
        group = self.robot.group(request.group_name)
        start, world = self._placed(request.start_state, now)
        reader = self._reader(group, start, world)
        if not request.goal_constraints:
            raise RequestError("INVALID_GOAL_CONSTRAINTS", "the request has no goal: send joint positions or a pose")
        goals = [goal for constraints in request.goal_constraints for goal in reader.goals(constraints)]
        scaling = _scaling(request.max_velocity_scaling_factor, request.max_acceleration_scaling_factor)
        motion = group.plan(
            MotionRequest(
                start=start,
                goals=goals,
                scene=world.scene,
                remaining_s=remaining_s,
                constraints=reader.path(request.path_constraints),
                planner_id=request.planner_id,
                searches=max(2, min(request.num_planning_attempts, MOST_SEARCHES)),
                scaling=scaling,
                margins=_margins(world),
            )
        )
        motion = slowed(group, motion, request.cartesian_speed_limited_link, request.max_cartesian_speed)
        return Planned(motion, start, group.group.name, begun_s - remaining_s())

    def inverse(self, request: PositionIKRequest, now: Snapshot) -> State:
        """Return a robot state in which a link is at a given pose. Raises RequestError or PlanningError."""
        group = self.robot.group(request.group_name)
        seed, world = self._placed(request.robot_state, now)
        if len(request.pose_stamped_vector) > 1:
            raise RequestError("INVALID_GOAL_CONSTRAINTS", "the request has several poses: send the pose of one link")
        stamped = request.pose_stamped_vector[0] if request.pose_stamped_vector else request.pose_stamped
        link = next(iter(request.ik_link_names), request.ik_link_name)
        reader = self._reader(group, seed, world)
        goal = reader.pose_goal(stamped, link, IK_POSITION_M, IK_TURN_RAD)
        scene = world.scene if request.avoid_collisions else None
        checks, broken = ConstraintChecks(self.robot, reader, request.constraints), list[str]()

        def accepts(state: State) -> bool:
            broken.append(checks.broken(state, self._frames(state, world)))
            return not broken[-1]

        try:
            group = group.narrowed(PathConstraints(reader.path(request.constraints).joints))
            return group.inverse(goal, seed, scene, _margins(world), accepts)
        except CollidingError as error:
            text = next((f"{text}: widen the constraint or move the pose" for text in broken if text), str(error))
            raise RequestError("NO_IK_SOLUTION", text) from None

    def forward(self, request: GetPositionFK.Request, now: Snapshot) -> list[PoseStamped]:
        """Return the poses of links in the frame given in the header. Raises RequestError or PlanningError."""
        state, world = self._placed(request.robot_state, now)
        frames = self._frames(state, world)
        base = frames.in_base(request.header.frame_id).inverse()
        if not request.fk_link_names:
            raise RequestError("INVALID_LINK_NAME", f"the request does not specify a link: choose from {self._links()}")
        found = []
        for link in request.fk_link_names:
            if link not in self.robot.description.links and link not in self.robot.links:
                raise RequestError("INVALID_LINK_NAME", f'there is no link "{link}": choose one of {self._links()}')
            pose = pose_message(base @ frames.in_base(link))
            header = Header(stamp=request.header.stamp, frame_id=request.header.frame_id or self.robot.frame)
            found.append(PoseStamped(header=header, pose=pose))
        return found

    def straight(self, request: GetCartesianPath.Request, now: Snapshot) -> tuple[State, LineMotion]:
        """Return the start state and a straight motion, as far as the motion is possible. Raises RequestError or
        PlanningError."""
        group = self.robot.group(request.group_name)
        start, world = self._placed(request.start_state, now)
        reader = self._reader(group, start, world)
        if not request.waypoints:
            raise RequestError("INVALID_GOAL_CONSTRAINTS", "the path has no waypoints: send at least one pose")
        link, offset = reader.planned_frame(request.link_name or None)
        found = group.straight(
            LineRequest(
                start=start,
                waypoints=[tool_pose(pose) for pose in self._waypoints(request, group, start, world)],
                scene=world.scene,
                link=link,
                offset=offset,
                steps=_steps(request),
                scaling=_scaling(request.max_velocity_scaling_factor, request.max_acceleration_scaling_factor),
                margins=_margins(world),
                avoid_collisions=request.avoid_collisions,
                constraints=reader.path(request.path_constraints),
            )
        )
        if found.motion is None:
            return start, found
        limited = request.cartesian_speed_limited_link
        return start, replace(found, motion=slowed(group, found.motion, limited, request.max_cartesian_speed))

    def _waypoints(
        self, request: GetCartesianPath.Request, group: GroupPlanner, start: State, world: PlanningWorld
    ) -> list[Pose]:
        """Return the poses of a straight path in the planning frame. As in MoveIt, each waypoint given in the frame of
        the moving link is relative to the previous waypoint. Raises RequestError or PlanningError."""
        frames, reader = self._frames(start, world), self._reader(group, start, world)
        name = request.header.frame_id.removeprefix("/")
        frame = frames.in_base(name)
        poses = [reader.goal_pose(pose) for pose in request.waypoints]
        if name and name == (request.link_name or group.group.tip):
            return list(accumulate(poses, Pose.__matmul__, initial=frame))[1:]
        return [frame @ pose for pose in poses]

    def validity(
        self, request: GetStateValidity.Request, now: Snapshot
    ) -> tuple[Validity, list[Evaluation], PlanningWorld]:
        """Return the result of a state check, the result for each constraint, and the scene. Raises RequestError."""
        state, world = self._placed(request.robot_state, now)
        found = self.robot.validity(state, world.scene, request.group_name)
        group = self.robot.group(request.group_name or next(iter(self.robot.groups.groups)))
        checks = ConstraintChecks(self.robot, self._reader(group, state, world), request.constraints)
        return found, checks.results(state, self._frames(state, world)), world

    def contacts(self, found: Validity, world: PlanningWorld) -> list[ContactInformation]:
        """Return a message for each pair in contact."""
        header = Header(frame_id=self.robot.frame)
        return [
            ContactInformation(
                header=header,
                contact_body_1=touch.one,
                body_type_1=self._kind(touch.one, world),
                contact_body_2=touch.other,
                body_type_2=self._kind(touch.other, world),
                depth=max(0.0, -touch.distance_m),
            )
            for touch in found.touches
        ]

    def _kind(self, name: str, world: PlanningWorld) -> int:
        if name in world.scene.attached:
            return int(ContactInformation.ROBOT_ATTACHED)
        return int(ContactInformation.ROBOT_LINK if name in self.robot.links else ContactInformation.WORLD_OBJECT)

    def _placed(self, message: RobotState, now: Snapshot) -> tuple[State, PlanningWorld]:
        state = state_of(self.robot, message, now.state)
        return state, world_of(self.robot, message, now.world, state)

    def _reader(self, group: GroupPlanner, state: State, world: PlanningWorld) -> ConstraintReader:
        return ConstraintReader(self.robot, self._frames(state, world), group.group.tip)

    def _frames(self, state: State, world: PlanningWorld) -> Frames:
        return Frames(self.robot, state, world.scene, world.items)

    def _links(self) -> str:
        return ", ".join(self.robot.description.links)


def _steps(request: GetCartesianPath.Request) -> Steps:
    if not 0.0 < request.max_step < math.inf:
        raise RequestError("FAILURE", f"max_step is {request.max_step} m: send a number above 0")
    given = (request.jump_threshold, request.prismatic_jump_threshold, request.revolute_jump_threshold)
    if any(math.isnan(value) for value in given):
        raise RequestError("INVALID_GOAL_CONSTRAINTS", "a jump threshold is NaN: send a number, or 0 for no limit")
    factor, prismatic_m, revolute_rad = (max(value, 0.0) for value in given)
    usual = Steps()
    return Steps(
        longest_m=request.max_step,
        jump_rad=revolute_rad or usual.jump_rad,
        jump_m=prismatic_m or usual.jump_m,
        jump_factor=factor,
    )


def _scaling(velocity: float, acceleration: float) -> Scaling:
    """Return the scaling factors. As in MoveIt, factors outside (0, 1] are replaced by 1. Raises RequestError."""
    for name, value in (("velocity", velocity), ("acceleration", acceleration)):
        if math.isnan(value) or 0.0 < value < SLOWEST:
            text = f"the {name} scaling factor is {value}: send a value from {SLOWEST} to 1"
            raise RequestError("PLANNING_FAILED", text)
    return Scaling(*(value if 0.0 < value <= 1.0 else 1.0 for value in (velocity, acceleration)))


def _margins(world: PlanningWorld) -> Margins:
    """Return the default margins, or the largest padding that a client has set."""
    usual = Margins()
    return Margins(max(usual.padding_m, *world.padding_m.values()), usual.tolerance_m) if world.padding_m else usual
