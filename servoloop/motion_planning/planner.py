"""Plan motions of an arm from the files of its folder: around the objects of its scene and those of the program."""

import math
import time
from collections.abc import Mapping
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.parameters import TrajectoryParameters
from hal.types import FloatArray, JointLimits, far_outside
from planning.arm_model import ArmModel
from planning.collision import Clearance, Collisions, warm_up
from planning.kinematics.chain import Chain
from planning.kinematics.goals import PoseGoal
from planning.kinematics.inverse import InverseKinematics
from planning.planner import plan_motion
from planning.request import PathRequest
from planning.scene import Scene
from planning.timing import scaled
from servoloop.api.errors import ArmInputError
from servoloop.api.options import ArmOptions
from servoloop.api.trajectory import ArmTrajectory
from servoloop.moveit.collision_matrix import reasons
from servoloop.stack.robot_files import Files
from sim_backend.scene.scene_file import scene_spec

TOUCHING: Final = ("Adjacent", "User", "Default", "Always")
"""Reasons for which two links of the arm may touch. Pairs that were never seen to touch are checked, too."""
POSES: Final = 500
"""Number of random poses from which the links follow that always touch."""
TIME_LIMIT_S: Final = 5.0
"""Default for the maximum time of a search, in seconds."""

Positions = Mapping[str, float]
"""Joint positions by joint name, in rad or m."""


class MotionPlanner:
    """Plans motions of one arm. The same seed, scene and request give the same motion. One thread may use it.

    Obstacles are the objects of the arm's scene file, such as its table, and all objects of ``scene``. The planner
    only computes: ``Arm.follow`` carries out its trajectories.
    """

    def __init__(self, arm: str, tool: str | None = None, seed: int = 1) -> None:
        """Read the files of an arm.

        Args:
            arm: Name or folder of the arm.
            tool: Link or site of the scene file that a pose goal brings to its pose. None: the last link that the
                arm's trajectory controller moves.
            seed: Seed of all random numbers, at least 1.

        Raises:
            ArmSetupError: The files of the arm are invalid.
            ArmInputError: The arm has no trajectory controller.
            PlanningError: The scene file does not have a joint or the tool.
        """
        warm_up()
        files = ArmOptions(arm).files()
        limits = _planned(files)
        self._model = ArmModel(scene_spec(files.scene).compile(), limits)
        self._chain = Chain(self._model.model, limits, tool or _last_link(self._model))
        self._kinematics = InverseKinematics(self._chain, seed)
        self._seed = seed
        allowed = {links for links, why in reasons(files.scene, POSES, seed).items() if why in TOUCHING}
        self.scene = Scene(allowed=frozenset(allowed))
        """Objects and pairs that may touch. Assign a changed copy, for example of ``scene.with_object``."""
        self.joints = self._model.joints
        """Names of the planned joints."""
        self.links = self._model.links
        """Names of the arm's links, to which objects can be attached."""
        self.objects = tuple(self._model.world_geoms())
        """Names of the objects of the arm's scene file. ``scene.without(name)`` removes one."""

    def pose(self, positions: Positions) -> tuple[FloatArray, FloatArray]:
        """Return the position (3,) in m and the quaternion (4,), x y z w, of the tool in the frame of the base."""
        pose = self._chain.pose(self._vector("the positions", positions))
        return pose.position_m, pose.quaternion_xyzw

    def clearance(self, positions: Positions) -> Clearance:
        """Return the smallest distance of the arm to itself and to all objects, and the pair that has it."""
        return Collisions(self._model, self.scene).clearance(self._vector("the positions", positions))

    def plan(
        self,
        start: Positions,
        goal: Positions | PoseGoal,
        *,
        speed: float = 1.0,
        time_limit_s: float = TIME_LIMIT_S,
    ) -> ArmTrajectory:
        """Plan a motion that touches nothing, within the limits of velocity, acceleration and jerk.

        Args:
            start: Positions of all planned joints at the start. Other joints, such as the hand's, are placed there
                for the collision checks.
            goal: Positions of planned joints, of which the others stay at their start; or a region of tool poses in
                the frame of the base.
            speed: Share of the limits, above 0 and at most 1.
            time_limit_s: Maximum time of the search, in seconds.

        Returns:
            A trajectory for ``Arm.follow``, which begins and ends at rest.

        Raises:
            ArmInputError: A joint is unknown or missing, or a position is not finite.
            PlanningError: The start or the goal is not possible, or no path was found in time. ``code`` is MoveIt's.
        """
        here = self._inside("the start", start)
        self._model.set_others({joint: at for joint, at in start.items() if joint not in self.joints})
        end_s = time.monotonic() + time_limit_s
        collisions = Collisions(self._model, self.scene)
        goals = self._goals(here, goal, collisions)
        request = PathRequest(here, goals, seed=self._seed)
        limits = scaled(self._model.limits, speed, speed)
        motion = plan_motion(self._model, collisions, request, lambda: end_s - time.monotonic(), limits)
        return ArmTrajectory(
            motion.times_s.tolist(),
            dict(zip(self.joints, motion.positions.T.tolist(), strict=True)),
            dict(zip(self.joints, motion.velocities.T.tolist(), strict=True)),
        )

    def _goals(self, here: FloatArray, goal: Positions | PoseGoal, collisions: Collisions) -> tuple[FloatArray, ...]:
        if isinstance(goal, PoseGoal):
            return tuple(self._kinematics.solve(goal, here, valid=collisions.is_clear))
        if unknown := sorted(goal.keys() - set(self.joints)):
            raise ArmInputError(f"the goal has no planned joint {unknown[0]}: choose one of {', '.join(self.joints)}")
        return (self._vector("the goal", {**dict(zip(self.joints, here.tolist(), strict=True)), **goal}),)

    def _inside(self, what: str, positions: Positions) -> FloatArray:
        """Return positions in joint order (n,). A joint slightly outside its limits counts as at its limit."""
        values = self._vector(what, positions)
        far = [bool(far_outside(at, limit)) for at, limit in zip(values.tolist(), self._model.limits, strict=True)]
        return np.where(far, values, np.clip(values, self._model.lower, self._model.upper))

    def _vector(self, what: str, positions: Positions) -> FloatArray:
        """Return positions in joint order (n,). Raises ArmInputError if one is missing or not finite."""
        if missing := [joint for joint in self.joints if joint not in positions]:
            raise ArmInputError(
                f"{what} need a position of {missing[0]}: give one for each of {', '.join(self.joints)}"
            )
        for joint, position in positions.items():
            if not math.isfinite(position):
                raise ArmInputError(f"{what}: {joint} is {position}: use a finite number", joint)
        return np.array([float(positions[joint]) for joint in self.joints])


def _planned(files: Files) -> dict[str, JointLimits]:
    """Return the limits of the joints that the arm's first trajectory controller moves, by joint name."""
    for spec in files.controllers.controllers:
        if isinstance(spec.parameters, TrajectoryParameters):
            return {joint: files.limits[joint] for joint in spec.parameters.joints}
    raise ArmInputError(f"{files.controllers.path}: the file has no {JointTrajectoryController.kind}: add one")


def _last_link(model: ArmModel) -> str:
    """Return the link that the last planned joint moves, whose other planned joints come before it."""
    bodies = [int(model.model.jnt_bodyid[joint]) for joint in model.joint_ids]
    return model.links[max(model.bodies.index(body) for body in bodies)]
