"""Kinematic chains of the arms, for the tests of kinematics."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from hypothesis import strategies as st

from hal.robot_description.description import Description, parse_urdf
from hal.types import FloatArray, JointLimits
from planning.kinematics.chain import Chain
from planning.kinematics.goals import PoseGoal, PositionSphere

ROOT = Path(__file__).parents[2]
FOLDERS = {
    "robot_arm": ("urdf/scene.xml", "urdf/robot_arm.urdf"),
    "so101": ("config/arms/so101/scene.xml", "config/arms/so101/arm.urdf"),
    "koch": ("config/arms/koch/scene.xml", "config/arms/koch/arm.urdf"),
}
"""Scene and URDF of each arm."""
TOOLS = {"robot_arm": "gripper_base_link", "so101": "gripper_link", "koch": "gripper_link"}
SHARES = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)
"""Positions of six joints, as shares of their ranges."""


@cache
def description(arm: str) -> Description:
    return parse_urdf((ROOT / FOLDERS[arm][1]).read_text(), FOLDERS[arm][1])


@cache
def model(arm: str) -> Any:
    return mujoco.MjModel.from_xml_path(str(ROOT / FOLDERS[arm][0]))


def limits(arm: str) -> Mapping[str, JointLimits]:
    """Return the limits of all joints between base and tool, starting at the base."""
    joints = {joint.child: joint for joint in description(arm).joints.values()}
    link, found = TOOLS[arm], {}
    while link in joints:
        found[joints[link].name] = joints[link].limits(acceleration=4.0, jerk=40.0)
        link = joints[link].parent
    return dict(reversed(found.items()))


@cache
def chain(arm: str) -> Chain:
    return Chain(model(arm), limits(arm), TOOLS[arm])


def random_positions(arm: str, number: int, seed: int) -> FloatArray:
    one = chain(arm)
    return np.random.default_rng(seed).uniform(one.lower, one.upper, (number, len(one.names)))


def at_shares(arm: str, shares: list[float]) -> FloatArray:
    """Return joint positions at shares of their ranges."""
    one = chain(arm)
    return one.lower + np.array(shares[: len(one.names)]) * (one.upper - one.lower)


def around(arm: str, positions: FloatArray, tolerance_m: float = 0.005, tolerance_rad: float = 0.05) -> PoseGoal:
    """Return a region around the pose of the tool at these joint positions."""
    return PoseGoal(chain(arm).pose(positions), PositionSphere(tolerance_m), (tolerance_rad,) * 3)
