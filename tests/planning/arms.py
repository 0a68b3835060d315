"""Arms of the planning tests."""

from pathlib import Path

import mujoco

from hal.types import JointLimits
from planning.arm_model import ArmModel

ROOT = Path(__file__).parents[2]


def limits(lower: float, upper: float) -> JointLimits:
    return JointLimits(lower, upper, velocity=1.5, acceleration=4.0, jerk=40.0)


def robot_arm() -> ArmModel:
    ranges = {"joint1": 3.05, "joint2": 2.0, "joint3": 2.0, "joint4": 2.0, "joint5": 2.0, "joint6": 3.05}
    return ArmModel(
        mujoco.MjModel.from_xml_path(str(ROOT / "urdf/scene.xml")),
        {name: limits(-end, end) for name, end in ranges.items()},
    )


def so101() -> ArmModel:
    ends = {
        "shoulder_pan": (-1.91986, 1.91986),
        "shoulder_lift": (-1.74533, 1.74533),
        "elbow_flex": (-1.69, 1.69),
        "wrist_flex": (-1.65806, 1.65806),
        "wrist_roll": (-2.74385, 2.84121),
    }
    return ArmModel(
        mujoco.MjModel.from_xml_path(str(ROOT / "config/arms/so101/scene.xml")),
        {name: limits(*end) for name, end in ends.items()},
    )


PLANAR = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" pos="0 0 -0.5"/>
    <geom name="post" type="box" size="0.05 0.05 0.5" pos="0.75 0.75 0"/>
    <body name="base">
      <geom type="cylinder" size="0.05 0.1"/>
      <body name="upper" pos="0 0 0.15">
        <joint name="one" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03"/>
        <geom type="sphere" size="0.5" contype="0" conaffinity="0"/>
        <body name="lower" pos="0.5 0 0">
          <joint name="two" axis="0 0 1"/>
          <geom type="box" pos="0.25 0 0" size="0.25 0.02 0.02"/>
          <body name="right" pos="0.5 0 0">
            <joint name="right" type="slide" axis="0 1 0"/>
            <geom type="box" size="0.05 0.005 0.01" pos="0.05 -0.01 0"/>
          </body>
          <body name="left" pos="0.5 0 0">
            <joint name="left" type="slide" axis="0 -1 0"/>
            <geom type="box" size="0.05 0.005 0.01" pos="0.05 0.01 0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="left" joint2="right" polycoef="0.01 2 0.5 0 0"/></equality>
</mujoco>
"""
"""An arm of two joints in a plane, with a hand whose left finger follows the right one."""


def planar(*joints: str, end: float = 3.0) -> ArmModel:
    return ArmModel.from_string(PLANAR, {name: limits(-end, end) for name in joints or ("one", "two")})
