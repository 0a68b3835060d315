"""The speed limit of a link holds in every part of a motion."""

from itertools import count

import numpy as np
import pytest

from nodes.planning.slowing import slowed
from planning.arm_model import ArmModel
from planning.group_planner import GroupPlanner
from planning.groups import Group
from planning.motion import JointGoal, MotionRequest
from planning.scene import Scene
from tests.planning.arms import limits, palletizer

JOINTS = ("turn", "shoulder", "crank")


def test_the_speed_limit_of_a_link_includes_the_motion_by_mimic_joints() -> None:
    model, ranges, ticks = palletizer(), dict.fromkeys(JOINTS, limits(-1.2, 1.2)), count()
    group, arm = GroupPlanner(model, ranges, Group("arm", JOINTS, "pen")), ArmModel(model, ranges)
    motion = group.plan(
        MotionRequest(
            start=dict.fromkeys(JOINTS, 0.0),
            goals=(JointGoal({"shoulder": 0.8, "crank": -0.6}),),
            scene=Scene(allowed=arm.everything()),
            remaining_s=lambda: 5.0 - 1e-5 * next(ticks),
        )
    )
    path = slowed(group, motion, "", 0.02).path
    places_m = []
    for positions in path.positions:
        arm.set(positions)
        places_m.append(arm.link_pose("pen")[0])
    speeds_m_s = np.linalg.norm(np.diff(places_m, axis=0), axis=1) / np.diff(path.times_s)
    assert speeds_m_s.max() == pytest.approx(0.02, rel=1e-6)
