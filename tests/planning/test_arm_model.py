"""Model of an arm from its scene: links, joints and world objects."""

import math

import numpy as np
import pytest

from planning.arm_model import ArmModel
from planning.planning_errors import PlanningError
from tests.planning.arms import PLANAR, limits, planar, robot_arm


def test_planned_joints_move_and_mimic_joints_follow_their_polynomial():
    arm = planar("one", "two", "right")
    arm.set(np.array([0.3, -0.4, 0.02]))
    assert arm.positions.tolist() == [0.3, -0.4, 0.02]
    assert float(arm.data.joint("left").qpos[0]) == pytest.approx(0.01 + 2 * 0.02 + 0.5 * 0.02**2)
    position, matrix = arm.link_pose("lower")
    assert position == pytest.approx([0.5 * math.cos(0.3), 0.5 * math.sin(0.3), 0.15])
    assert math.atan2(matrix[1, 0], matrix[0, 0]) == pytest.approx(-0.1)


def test_other_joints_keep_their_positions():
    arm = planar()
    arm.set_others({"right": 0.01})
    arm.set(np.array([1.0, 1.0]))
    assert float(arm.data.joint("left").qpos[0]) == pytest.approx(0.03005)


def test_bodies_outside_the_arm_are_world_objects():
    arm = planar()
    assert arm.links == ("base", "upper", "lower", "right", "left")
    assert {name: len(geoms) for name, geoms in arm.world_geoms().items()} == {"floor": 1, "post": 1}
    assert {name: len(geoms) for name, geoms in arm.link_geoms().items()} == dict.fromkeys(arm.links, 1)
    assert arm.adjacent() == {("base", "upper"), ("lower", "upper"), ("lower", "right"), ("left", "lower")}


def test_a_scene_of_the_project_has_its_cube_stand_and_bins_as_objects():
    objects = robot_arm().world_geoms()
    assert {name: len(geoms) for name, geoms in objects.items()} == {
        "table": 1, "stand": 1, "cube": 1, "bin_A": 5, "bin_B": 5, "bin_C": 5,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("joints", "code", "words"),
    [
        (["three"], "INVALID_ROBOT_STATE", 'no joint "three": choose one of one, two, right, left'),
        (["left"], "INVALID_ROBOT_STATE", "left follows right: plan for right instead"),
    ],
)
def test_a_joint_that_cannot_be_planned_is_named(joints, code, words):
    with pytest.raises(PlanningError, match=words) as caught:
        ArmModel.from_string(PLANAR, {name: limits(-1.0, 1.0) for name in joints})
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        ([0.0, 3.5], "two is at 3.5000, outside its limits -3.0000 to 3.0000"),
        ([math.nan, 0.0], "one is at nan: give a finite position"),
        ([0.0, 0.0], ""),
    ],
)
def test_positions_outside_the_limits_are_described(positions, words):
    assert planar().outside(np.array(positions)) == words


def test_an_unknown_link_is_refused_with_the_links_that_exist():
    with pytest.raises(PlanningError, match='no link "hand": choose one of base, upper'):
        planar().link_pose("hand")
