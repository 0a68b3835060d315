"""Check whether MoveIt can start planning from a pose.

The padded arm must not touch the objects around it, and the arm without padding must not touch itself.
"""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from hal.robot_file.robot_file import load_robot_file
from servoloop.motion_planning.collision_matrix import LinkModel, Pair, arm_links, arm_roots
from servoloop.moveit.surroundings import Objects, Pose, spec_with
from servoloop.stack.arm_folders import ArmFolder
from servoloop.stack.pick_place import PickPlace, arm_jobs
from sim_backend.scene.world import World

SETTLE_S: Final = 4.0
"""Simulated time for a limp arm to come to rest, in seconds."""
FAR_M: Final = 1.0


class PaddedArm:
    """Arm with padding, as checked by MoveIt."""

    def __init__(self, scene: Path, objects: Objects, padding_m: float, unchecked: Collection[Pair] = ()) -> None:
        """``unchecked`` are the pairs of links excluded by the SRDF."""
        self._links = LinkModel(scene)
        self._unchecked = set(unchecked)
        spec, names = spec_with(scene, objects, padding_m)
        roots = arm_roots(spec, scene)
        links = {link.name for link in arm_links(roots) if link not in roots}  # plans do not move the base
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        self._places = [int(self._model.joint(name).qposadr[0]) for name in self._links.joints]
        self._objects = [self._model.geom(name).id for name in names]
        model = self._model
        self._arm = [
            geom
            for geom in range(model.ngeom)
            if model.body(model.geom_bodyid[geom]).name in links
            and (model.geom_contype[geom] or model.geom_conaffinity[geom])
        ]
        meshes = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
        self._padding_m = np.where(meshes, padding_m, 0.0)
        """Padding of meshes, because meshes are not enlarged in the model. The value is zero for all other
        geometries."""

    def distances(self, pose: Pose) -> dict[Pair, float]:
        """Return the distance between each link and each object, in m; negative if they overlap."""
        self._data.qpos[self._places] = self._links.pose(dict(pose))
        mujoco.mj_kinematics(self._model, self._data)
        found: dict[Pair, float] = {}
        for geom in self._arm:
            link = self._model.body(self._model.geom_bodyid[geom]).name
            for other in self._objects:
                gap = mujoco.mj_geomDistance(self._model, self._data, geom, other, FAR_M, None) - self._padding_m[geom]
                key = (link, self._model.geom(other).name.rsplit(" ", 1)[0])
                found[key] = min(found.get(key, FAR_M), float(gap))
        return found

    def collisions(self, pose: Pose) -> list[str]:
        """Return the pairs that cause MoveIt to reject a pose. The list is empty if MoveIt can start planning from the
        pose."""
        around = [f"{link} - {thing}" for (link, thing), gap in self.distances(pose).items() if gap <= 0.0]
        itself = self._links.touching(self._links.pose(dict(pose))) - self._unchecked
        return sorted(around) + [f"{one} - {other}" for one, other in sorted(itself)]


def released_pose(scene: Path, pose: Pose) -> Pose:
    """Return the pose in which an arm comes to rest after its torque is disabled in ``pose``."""
    start = World(scene)
    world = World(scene, initial_position=[pose.get(joint, 0.0) for joint in start.joints])
    for _ in range(round(SETTLE_S / world.timestep_s)):
        world.advance()
    return dict(zip(world.joints, world.position().tolist(), strict=True))


def rest_poses(arm: ArmFolder) -> dict[str, Pose]:
    """Return the rest poses: at stack startup and parked, each with torque enabled and disabled."""
    world, park = World(arm.scene), load_robot_file(arm.robot).park
    begin = dict(zip(world.joints, world.position().tolist(), strict=True))
    poses: dict[str, Pose] = {"the start": begin}
    if world.lies:
        poses["the start, limp"] = released_pose(arm.scene, begin)
    if park is not None:
        for hand, at in _hands(arm, world):
            poses[f"park, {hand}"] = {**at, **park.pose}
            poses[f"park, {hand}, limp"] = released_pose(arm.scene, {**at, **park.pose})
    return poses


def working_poses(arm: ArmFolder) -> dict[str, Pose]:
    """Return the poses of the pick-and-place job with the hand open and closed, and the zero pose.

    The mock hardware starts in the zero pose.
    """
    world = World(arm.scene)
    poses: dict[str, Pose] = {"zero": {}}
    for name, pose in _arm_poses(arm_jobs(arm.pick_place)):
        poses |= {f"{name}, {hand}": {**at, **pose} for hand, at in _hands(arm, world)}
    return poses


def _arm_poses(jobs: Mapping[str, PickPlace]) -> Iterator[tuple[str, Pose]]:
    """Yield each pose of each arm, with the other arms in their ready poses."""
    ready = {joint: at for job in jobs.values() for joint, at in zip(job.joints, job.poses.ready, strict=True)}
    for arm, job in jobs.items():
        for name, pose in job.all_poses().items():
            yield f"{arm} {name}".lstrip(), {**ready, **dict(zip(job.joints, pose, strict=True))}


def _hands(arm: ArmFolder, world: World) -> list[tuple[str, Pose]]:
    """Return the positions of all hands, open and closed."""
    opened, closed = dict[str, float](), dict[str, float]()
    for name, job in arm_jobs(arm.pick_place).items():
        prefix = f"{name}_" if name else ""
        hand = [joint for joint in world.joints if joint.startswith(prefix) and joint not in job.joints][-1]
        opened[hand], closed[hand] = job.hand_open_m, job.hand_closed_m
    return [("hand open", opened), ("hand closed", closed)]
