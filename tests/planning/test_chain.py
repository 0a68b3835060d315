"""The pose of the tool and its Jacobian agree with MuJoCo, with the URDF and with finite differences."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.robot_description.kinematics import child_pose, multiply, rotate
from hal.rotations import matrices, rotation_vectors
from hal.types import FloatArray, JointLimits
from planning.kinematics.chain import Chain
from planning.planning_errors import PlanningError
from tests.planning.chains import SHARES, TOOLS, at_shares, chain, description, limits, model

ARMS = st.sampled_from(sorted(TOOLS))
ODD = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="stand" pos="1 2 3" euler="0.3 0.2 0.1">
      <body name="slide" pos="0 0 0.1">
        <joint name="rail" type="slide" axis="1 2 0"/>
        <geom size="0.01"/>
        <body name="arm" pos="0.2 0 0" euler="0 0.4 0">
          <joint name="first" axis="0 1 1" pos="0.05 0.02 0" ref="0.3"/>
          <joint name="second" axis="1 0 0"/>
          <geom size="0.01"/>
          <body name="held" pos="0 0 0.1">
            <joint name="held" axis="1 0 0"/>
            <geom size="0.01"/>
            <site name="tip" pos="0.1 0 0.05" euler="0.1 0.2 0.3"/>
          </body>
        </body>
      </body>
    </body>
    <body name="ball"><freejoint name="ball"/><geom size="0.01"/></body>
  </worldbody>
</mujoco>
"""
"""An arm on a tilted stand with a rail, two joints on one body, an anchor off the body and a joint that is held."""
ODD_MODEL = mujoco.MjModel.from_xml_string(ODD)
LIMIT = JointLimits(-1.0, 1.0, 1.0, 1.0, 1.0)


def odd(*names: str, tool: str = "tip", base: str | None = None) -> Chain:
    return Chain(ODD_MODEL, dict.fromkeys(names, LIMIT), tool, base)


def mujoco_state(model: object, joints: tuple[str, ...], positions: FloatArray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    for name, position in zip(joints, positions, strict=True):
        data.joint(name).qpos[0] = position
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data


@settings(max_examples=40)
@given(ARMS, SHARES)
def test_pose_and_jacobian_equal_those_of_mujoco(arm: str, shares: list[float]) -> None:
    one, positions = chain(arm), at_shares(arm, shares)
    data = mujoco_state(model(arm), one.names, positions)
    pose, jacobian = one.pose(positions), np.zeros((6, model(arm).nv))
    mujoco.mj_jacBody(model(arm), data, jacobian[:3], jacobian[3:], model(arm).body(one.tool).id)
    columns = [model(arm).joint(name).dofadr[0] for name in one.names]
    assert pose.position_m == pytest.approx(data.body(one.tool).xpos, abs=1e-12)
    assert matrices(pose.quaternion_xyzw).ravel() == pytest.approx(data.body(one.tool).xmat, abs=1e-12)
    assert one.transforms_and_jacobians(positions[None])[1][0] == pytest.approx(jacobian[:, columns], abs=1e-12)


@settings(max_examples=40)
@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.permutations(["rail", "first", "second"]))
def test_an_odd_arm_equals_mujoco_in_the_frame_of_its_base(values: list[float], names: list[str]) -> None:
    one, positions = odd(*names), np.array(values)
    data = mujoco_state(ODD_MODEL, one.names, positions)
    base = data.body("stand").xmat.reshape(3, 3)
    pose = one.pose(positions)
    assert pose.position_m == pytest.approx(base.T @ (data.site("tip").xpos - data.body("stand").xpos), abs=1e-12)
    assert matrices(pose.quaternion_xyzw) == pytest.approx(base.T @ data.site("tip").xmat.reshape(3, 3), abs=1e-12)
    assert one.transforms_and_jacobians(positions[None])[1][0] == pytest.approx(differences(one, positions), abs=1e-8)


@settings(max_examples=40)
@given(ARMS, SHARES)
def test_the_jacobian_is_the_derivative_of_the_pose(arm: str, shares: list[float]) -> None:
    positions = at_shares(arm, shares)
    assert chain(arm).transforms_and_jacobians(positions[None])[1][0] == pytest.approx(
        differences(chain(arm), positions), abs=1e-8
    )


def differences(one: Chain, positions: FloatArray) -> FloatArray:
    """Return the Jacobian (6, n) from central differences."""
    step = 1e-6 * np.eye(len(positions))
    after, before = one.transforms(positions + step), one.transforms(positions - step)
    turned = rotation_vectors(after[:, :3, :3] @ before[:, :3, :3].swapaxes(1, 2))
    return np.concatenate([after[:, :3, 3] - before[:, :3, 3], turned], axis=1).T / 2e-6


@settings(max_examples=40)
@given(ARMS, SHARES)
def test_the_pose_equals_that_of_the_urdf(arm: str, shares: list[float]) -> None:
    position, turned = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    positions = at_shares(arm, shares)
    for name, value in zip(limits(arm), positions.tolist(), strict=True):
        offset, rotation = child_pose(description(arm).joints[name], value)
        step = rotate(turned, offset)
        position = (position[0] + step[0], position[1] + step[1], position[2] + step[2])
        turned = multiply(turned, rotation)
    pose = chain(arm).pose(positions)
    assert pose.position_m == pytest.approx(position, abs=2e-5)  # the scenes contain rounded angles
    assert matrices(pose.quaternion_xyzw) == pytest.approx(matrices(np.array(turned)), abs=2e-5)


def test_an_arm_without_a_fixed_body_stands_on_the_world() -> None:
    """MuJoCo merges the base of a URDF with the world."""
    text = """<mujoco><worldbody><body name="link" pos="0 0 0.5"><joint name="one" axis="0 0 1"/><geom size="0.1"/>
      <site name="tip" pos="0.2 0 0"/></body></worldbody></mujoco>"""
    one = Chain(mujoco.MjModel.from_xml_string(text), {"one": LIMIT}, "tip")
    assert one.pose(np.array([np.pi / 2.0])).position_m == pytest.approx([0.0, 0.2, 0.5])


@pytest.mark.parametrize(
    ("names", "tool", "base", "code", "text"),
    [
        (["rail"], "hand", None, "INVALID_LINK_NAME", "no body or site hand: choose one of world, stand, slide, arm"),
        (["rail"], "tip", "floor", "INVALID_LINK_NAME", "the model has no body floor"),
        (["elbow"], "tip", None, "INVALID_ROBOT_STATE", "no joint elbow: choose one of rail, first, second, held"),
        (["ball"], "tip", None, "INVALID_ROBOT_STATE", "ball is neither a hinge nor a slide"),
        (["first"], "slide", None, "INVALID_LINK_NAME", "joint first does not move slide"),
        (["rail"], "tip", "slide", "INVALID_LINK_NAME", "joint rail does not move tip"),
        (["rail"], "tip", "ball", "INVALID_LINK_NAME", "tip is not part of the arm that is mounted on ball"),
    ],
)
def test_wrong_names_are_refused(names: list[str], tool: str, base: str | None, code: str, text: str) -> None:
    with pytest.raises(PlanningError, match=text) as caught:
        odd(*names, tool=tool, base=base)
    assert caught.value.code == code
