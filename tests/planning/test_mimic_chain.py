"""A chain whose mimic joints move the tool agrees with MuJoCo, and so does every plan that uses the chain."""

import math
from itertools import count

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.rotations import matrices, quaternions
from hal.types import FloatArray, JointLimits
from planning.arm_model import ArmModel
from planning.collision import Collisions, Margins
from planning.constraints import LinkRegion, PathConstraints
from planning.group_planner import GroupPlanner
from planning.groups import Group
from planning.kinematics.cartesian import Steps
from planning.kinematics.chain import Chain, ToolPose
from planning.kinematics.goals import PoseGoal, PositionSphere
from planning.kinematics.inverse import InverseKinematics
from planning.motion import LineRequest, MotionRequest, State, ToolGoal
from planning.planning_errors import PlanningError
from planning.scene import Pose, Scene, SceneObject, Sphere
from tests.planning.arms import LINKAGE, limits, palletizer
from tests.planning.test_chain import differences

JOINTS = ("turn", "shoulder", "crank")
LIMIT = JointLimits(-1.2, 1.2, 2.0, 10.0, 100.0)
POSITIONS = st.lists(st.floats(-1.2, 1.2), min_size=3, max_size=3)
TERMS = st.lists(st.integers(-100, 100).map(lambda number: number / 100.0), min_size=5, max_size=5)
TOLERANCE_M = 0.002


MODEL = palletizer()
ARM = ArmModel(MODEL, dict.fromkeys(JOINTS, LIMIT))
GROUP = GroupPlanner(MODEL, dict.fromkeys(JOINTS, LIMIT), Group("arm", JOINTS, "pen"))
FREE = Scene(allowed=ARM.everything())
START = {"turn": 0.1, "shoulder": 0.2, "crank": 0.4}


def placed(arm: ArmModel, positions: FloatArray, link: str = "pen") -> Pose:
    """Return the pose of a link in the frame of the stand, according to MuJoCo."""
    arm.set(positions)
    return Pose(*arm.link_pose("stand")).inverse() @ Pose(*arm.link_pose(link))


def at(positions: FloatArray | State) -> FloatArray:
    """Return the position of the pen, according to MuJoCo."""
    values = [positions[joint] for joint in JOINTS] if isinstance(positions, dict) else positions
    return placed(ARM, np.array(values)).position_m


def around(position_m: FloatArray) -> PoseGoal:
    return PoseGoal(ToolPose(position_m, np.array([0.0, 0, 0, 1])), PositionSphere(TOLERANCE_M), (4.0, 4.0, 4.0))


def request(goal: PoseGoal, constraints: PathConstraints | None = None) -> MotionRequest:
    ticks = count()
    return MotionRequest(
        start=START,
        goals=(ToolGoal(goal),),
        scene=FREE,
        remaining_s=lambda: 5.0 - 1e-5 * next(ticks),
        constraints=constraints or PathConstraints(),
    )


@settings(max_examples=60)
@given(POSITIONS, st.permutations(JOINTS), TERMS, TERMS, TERMS)
def test_pose_and_jacobian_of_a_chain_with_mimic_joints_equal_those_of_mujoco(
    values: list[float], names: list[str], elbow: list[float], level: list[float], lift: list[float]
) -> None:
    model, positions = palletizer({"elbow": elbow, "level": level, "lift": lift}), np.array(values)
    chain = Chain(model, dict.fromkeys(names, LIMIT), "pen")
    wanted, pose = placed(ArmModel(model, dict.fromkeys(names, LIMIT)), positions), chain.pose(positions)
    assert pose.position_m == pytest.approx(wanted.position_m, abs=1e-9)
    assert matrices(pose.quaternion_xyzw) == pytest.approx(wanted.matrix, abs=1e-9)
    tools, jacobians = chain.transforms_and_jacobians(positions[None])
    assert tools[0, :3, 3] == pytest.approx(wanted.position_m, abs=1e-9)
    assert jacobians[0] == pytest.approx(differences(chain, positions), abs=1e-5)


@settings(max_examples=20, deadline=None)
@given(POSITIONS)
def test_a_pose_that_an_arm_with_mimic_joints_reaches_is_found(values: list[float]) -> None:
    wanted = at(np.array(values))
    assert np.linalg.norm(at(GROUP.inverse(ToolGoal(around(wanted)), START)) - wanted) <= TOLERANCE_M


def test_a_leader_beside_the_arm_is_part_of_the_chain_of_the_tool() -> None:
    assert GROUP.chain("pen", START).names == JOINTS
    assert GROUP.chain("upper", START).names == ("turn", "shoulder")
    with pytest.raises(PlanningError, match="joint crank does not move upper"):
        Chain(MODEL, {"crank": LIMIT}, "upper")


def test_a_mimic_joint_whose_leader_is_not_planned_stays_at_its_position() -> None:
    others = {joint: LIMIT for joint in JOINTS if joint != "crank"}
    group = GroupPlanner(MODEL, dict.fromkeys(JOINTS, LIMIT), Group("arm", tuple(others), "pen"))
    assert group.chain(None, START).pose(np.array([0.1, 0.2])).position_m == pytest.approx(at(START))


def test_a_plan_of_an_arm_with_mimic_joints_ends_at_the_goal() -> None:
    wanted = at(np.array([0.5, 0.8, -0.3]))
    assert np.linalg.norm(at(GROUP.plan(request(around(wanted))).end) - wanted) <= TOLERANCE_M


def test_a_region_of_a_path_constraint_follows_the_mimic_joints() -> None:
    begin, wanted = at(START), at(np.array([0.5, 0.4, 0.4]))
    sphere = PoseGoal(ToolPose(begin, np.array([0.0, 0, 0, 1])), PositionSphere(0.3), (4.0, 4.0, 4.0))
    path = GROUP.plan(request(around(wanted), PathConstraints(regions=(LinkRegion(sphere),)))).path
    assert max(np.linalg.norm(at(row) - begin) for row in path.positions) <= 0.31


def test_the_tool_of_an_arm_with_mimic_joints_moves_along_a_straight_line() -> None:
    begin, step = placed(ARM, np.array(list(START.values()))), np.array([0.03, 0.02, -0.04])
    target = ToolPose(begin.position_m + step, quaternions(begin.matrix))
    line = LineRequest(start=START, waypoints=(target,), scene=FREE, steps=Steps(deviation_rad=(4.0, 4.0, 4.0)))
    motion = GROUP.straight(line).motion
    assert motion is not None
    moved = np.array([at(row) for row in motion.path.positions]) - begin.position_m
    share = moved @ step / (step @ step)
    assert moved[-1] == pytest.approx(step, abs=1e-3)
    assert np.linalg.norm(moved - share[:, None] * step, axis=1).max() < 1e-3


def test_a_joint_with_mimic_joints_keeps_its_turns_in_solutions() -> None:
    """A full turn of the crank does not turn the elbow fully, and so moves the tool."""
    model = palletizer({**LINKAGE, "elbow": (0.0, 0.5, 0.0, 0.0, 0.0)})
    names = dict.fromkeys(JOINTS, LIMIT) | {"crank": JointLimits(-9.0, 9.0, 2.0, 10.0, 100.0)}
    chain = Chain(model, names, "pen")
    goal = around(chain.pose(np.array([0.3, 0.4, 0.5])).position_m)
    found = InverseKinematics(chain).solve(goal, np.array([0.3, 0.4, 7.0]))
    assert goal.contains(chain.transforms(found)).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), TERMS, TERMS)
def test_every_point_of_an_accepted_edge_of_an_arm_with_mimic_joints_has_the_clearance(
    seed: int, level: list[float], lift: list[float]
) -> None:
    arm = ArmModel(palletizer({**LINKAGE, "level": level, "lift": lift}), dict.fromkeys(JOINTS, LIMIT))
    random, scene = np.random.default_rng(seed), Scene()
    for number, positions in enumerate(random.uniform(-1.2, 1.2, (3, 3))):
        arm.set(positions)
        ball = SceneObject(f"ball{number}", ((Sphere(0.02), Pose()),), Pose(*arm.link_pose("pen")))
        scene = scene.with_object(ball)
    collisions, (start, end) = Collisions(arm, scene), random.uniform(-1.2, 1.2, (2, 3))
    contact = collisions.edge_contact(start, end, Margins(0.004, 0.002))
    if contact is None:
        parts = np.linspace(0.0, 1.0, 300)
        distances_m = [collisions.clearance(start + part * (end - start)).distance_m for part in parts]
        assert min(distances_m) >= 0.002 - 1e-6
    else:
        assert collisions.clearance(start + contact.part * (end - start)).distance_m < 0.004 + 1e-5


def test_a_link_that_follows_a_joint_through_another_mimic_joint_is_checked_for_contacts() -> None:
    scene = """<mujoco><worldbody><body name="base">
      <body name="one"><joint name="one" axis="0 0 1"/><geom size="0.01"/></body>
      <body name="two"><joint name="two" axis="0 0 1"/><geom size="0.01" pos="0 0 0.1"/></body>
      <body name="three" pos="0 0 0.2"><joint name="three" type="slide" axis="1 0 0"/><geom size="0.01"/></body></body>
      <geom name="wall" type="sphere" size="0.05" pos="0.5 0 0.2"/></worldbody>
      <equality><joint joint1="two" joint2="one"/><joint joint1="three" joint2="two"/></equality></mujoco>"""
    collisions = Collisions(ArmModel.from_string(scene, {"one": limits(-1.0, 1.0)}), Scene())
    contact = collisions.edge_contact(np.zeros(1), np.ones(1))
    assert contact is not None and contact.pair == ("three", "wall")


def test_a_joint_without_limits_that_moves_a_nonlinear_mimic_joint_is_refused_by_its_name() -> None:
    endless = dict.fromkeys(JOINTS, LIMIT) | {"shoulder": limits(-math.inf, math.inf)}
    with pytest.raises(PlanningError, match=r"shoulder has no limits, .* nonlinearly: set limits for shoulder"):
        Collisions(ArmModel(MODEL, endless), Scene())
