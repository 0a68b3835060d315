"""Find the pairs of links that MoveIt does not need to check for collisions, for <disable_collisions> in the SRDF.

Poses are sampled in the same way as in MoveIt's setup assistant. The geometry is taken from the arm's scene; tests
ensure that it matches the geometry in the URDF.
"""

import itertools
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from hal.hal_errors import ArmFileError
from hal.types import FloatArray
from sim_backend.scene.scene_file import scene_spec

SAMPLES: Final = 100_000
SEED: Final = 1
ALWAYS: Final = 0.95
"""Minimum fraction of poses in which a pair of links must touch to count as touching by design.

MoveIt's setup assistant uses the same value.
"""
OFTEN: Final = 0.05
"""Minimum fraction of poses in which two links must be near each other to count as near by design, although they never
touch."""
JOINT_DRIVES: Final = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)

Pair = tuple[str, str]


def pair(one: str, other: str) -> Pair:
    """Return a pair of links in sorted order."""
    return (one, other) if one < other else (other, one)


def arm_roots(spec: Any, scene: Path) -> list[Any]:
    """Return the bodies on which the arm of a scene stands, which are the roots of the joints with actuators.

    Raises ArmFileError if no joint of the scene has an actuator, or if one of these bodies has no name.
    """
    names = [one.target for one in spec.actuators if one.trntype in JOINT_DRIVES]
    roots: list[Any] = []
    for joint in filter(None, map(spec.joint, names)):
        body = joint.parent
        while body.parent != spec.worldbody:
            body = body.parent
        if body not in roots:
            roots.append(body)
    if not roots:
        raise ArmFileError(
            f"{scene}: no joint of the scene has an actuator: add an actuator for each joint with a servo"
        )
    if not all(root.name for root in roots):
        raise ArmFileError(
            f"{scene}: the body on which the arm stands has no name: give it the name of the first link of the URDF"
        )
    return roots


def arm_links(roots: Iterable[Any]) -> list[Any]:
    """Return the bodies of an arm that stands on the bodies ``roots``."""
    return [link for root in roots for link in (root, *root.find_all(mujoco.mjtObj.mjOBJ_BODY))]


class LinkModel:
    """Model of the arm in a scene, without other objects, for finding collisions between the arm's own links.

    Raises ArmFileError if the scene has errors.
    """

    def __init__(self, scene: Path) -> None:
        spec = scene_spec(scene)
        roots = arm_roots(spec, scene)
        links = arm_links(roots)
        self.links = sorted(str(link.name) for link in links)
        self.adjacent = {pair(str(link.parent.name), str(link.name)) for link in links if link not in roots}
        for geom in spec.geoms:
            collides = geom.contype or geom.conaffinity
            geom.contype = geom.conaffinity = int(bool(collides) and geom.parent.name in self.links)
        self.model: Any = spec.compile()
        self.data: Any = mujoco.MjData(self.model)
        mobile = [self.model.joint(i) for i in range(self.model.njnt)]
        owned = [joint for joint in mobile if self.model.body(joint.bodyid[0]).name in self.links]
        self.joints = tuple(str(joint.name) for joint in owned)
        """All joints, including mimic joints, in the order used in poses."""
        self.followers = _followers(self.model)
        """Joint that each mimic joint follows, with the polynomial that relates their positions."""
        self._places = [int(joint.qposadr[0]) for joint in owned]
        self._ranges = np.array([_range(self.model, joint) for joint in owned])

    def pose(self, positions: dict[str, float]) -> FloatArray:
        """Return a pose with the given joint positions.

        Other joints are at 0; mimic joints follow the joints that they mimic.
        """
        values = {name: positions.get(name, 0.0) for name in self.joints}
        return self._followed(np.array(list(values.values())))

    def default_pose(self) -> FloatArray:
        """Return MoveIt's default pose: each joint is at 0, or in the middle of its range if 0 is outside the range.
        Mimic joints follow the joints that they mimic."""
        low, high = self._ranges.T
        return self._followed(np.where((low <= 0.0) & (high >= 0.0), 0.0, (low + high) / 2.0))

    def random_pose(self, random: np.random.Generator) -> FloatArray:
        """Return random joint positions within the limits. Mimic joints follow the joints that they mimic."""
        low, high = self._ranges.T
        return self._followed(random.uniform(low, high))

    def _followed(self, pose: FloatArray) -> FloatArray:
        for follower, (leader, polynomial) in self.followers.items():
            at = pose[self.joints.index(leader)]
            pose[self.joints.index(follower)] = np.polynomial.polynomial.polyval(at, polynomial)
        return pose

    def place(self, pose: FloatArray) -> None:
        """Place the arm in a pose."""
        self.data.qpos[self._places] = pose
        mujoco.mj_kinematics(self.model, self.data)

    def touching(self, pose: FloatArray) -> set[Pair]:
        """Return the pairs of non-adjacent links that overlap in a pose."""
        return self.nearer(pose, 0.0)

    def nearer(self, pose: FloatArray, below_m: float) -> set[Pair]:
        """Return the pairs of non-adjacent links that are closer than ``below_m`` meters in a pose."""
        self.place(pose)
        self.model.geom_margin[:] = below_m
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        pairs = set()
        for geoms in self.data.contact.geom[self.data.contact.dist <= below_m]:
            one, other = (self.model.body(self.model.geom_bodyid[geom]).name for geom in geoms)
            pairs.add(pair(one, other))
        return pairs - self.adjacent

    def meeting(self) -> set[Pair]:
        """Return the pairs of links that are driven by the same servo, such as two fingers. These links are meant to
        touch."""
        link = {name: self.model.body(self.model.joint(name).bodyid[0]).name for name in self.joints}
        return {pair(link[follower], link[leader]) for follower, (leader, _) in self.followers.items()}


def _range(model: Any, joint: Any) -> tuple[float, float]:
    """Return the range of a joint, which is one turn for a hinge without limits."""
    if joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE and not model.jnt_limited[joint.id]:
        return -np.pi, np.pi
    low, high = joint.range
    return float(low), float(high)


def _followers(model: Any) -> dict[str, tuple[str, FloatArray]]:
    rows = [
        row for row in range(model.neq) if model.eq_type[row] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj2id[row] >= 0
    ]
    return {
        model.joint(model.eq_obj1id[row]).name: (model.joint(model.eq_obj2id[row]).name, model.eq_data[row, :5].copy())
        for row in rows
    }


def count(arm: LinkModel, samples: int, seed: int) -> Counter[Pair]:
    """Return the number of random poses in which each pair of links touches."""
    random = np.random.default_rng(seed)
    return Counter(itertools.chain.from_iterable(arm.touching(arm.random_pose(random)) for _ in range(samples)))


def reasons(scene: Path, samples: int = SAMPLES, seed: int = SEED) -> dict[Pair, str]:
    """Return the pairs that do not need a collision check, each with MoveIt's term for the reason."""
    arm = LinkModel(scene)
    touched = count(arm, samples, seed)
    by_default = arm.touching(arm.default_pose())
    meeting = arm.meeting()

    def reason(links: Pair) -> str | None:
        if links in arm.adjacent:
            return "Adjacent"
        if links in meeting:
            return "User"
        if links in by_default:
            return "Default"
        if touched[links] > ALWAYS * samples:
            return "Always"
        return None if touched[links] else "Never"

    found = {links: reason(links) for links in itertools.combinations(arm.links, 2)}
    return {links: why for links, why in found.items() if why is not None}


def near_by_design(scene: Path, below_m: float, samples: int, seed: int) -> set[Pair]:
    """Return the pairs of links that are often closer than ``below_m`` meters but do not touch in any random pose.

    Such a pair has a narrow gap by design, such as a jaw and the wrist that it passes.
    """
    arm, random = LinkModel(scene), np.random.default_rng(seed)
    poses = [arm.random_pose(random) for _ in range(samples)]
    near = Counter(itertools.chain.from_iterable(arm.nearer(pose, below_m) for pose in poses))
    often = {links for links, number in near.items() if number > OFTEN * samples}
    return often.difference(*(arm.touching(pose) for pose in poses)) if often else set()


def lines(found: dict[Pair, str]) -> list[str]:
    """Return the <disable_collisions> elements of the SRDF."""
    return [
        f'  <disable_collisions link1="{one}" link2="{other}" reason="{why}"/>' for (one, other), why in found.items()
    ]
