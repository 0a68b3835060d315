"""Arms of the planning tests."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

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


PALLETIZER = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="stand" pos="0.1 0.2 0.3" euler="0.3 0.2 0.1">
      <geom type="sphere" size="0.01"/>
      <body name="column"><joint name="turn" axis="0 0 1"/><geom type="sphere" size="0.01"/>
        <body name="crank"><joint name="crank" axis="0 1 0" ref="0.2"/><geom type="sphere" size="0.01"/></body>
        <body name="upper" pos="0 0 0.1"><joint name="shoulder" axis="0 1 0"/><geom type="sphere" size="0.01"/>
          <body name="fore" pos="0 0 0.3"><joint name="elbow" axis="0 1 0" ref="0.1"/>
            <geom type="sphere" size="0.01"/>
            <body name="flange" pos="0.25 0 0"><joint name="level" axis="0 1 0"/><joint name="lift" type="slide"/>
              <geom type="sphere" size="0.01"/>
              <body name="pen" pos="0.05 0 -0.05"><geom type="sphere" size="0.01"/></body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="lift" joint2="level" polycoef="{lift}"/>
    <joint joint1="level" joint2="shoulder" polycoef="{level}"/>
    <joint joint1="elbow" joint2="crank" polycoef="{elbow}"/>
  </equality>
</mujoco>
"""
"""An arm whose elbow follows a crank beside the arm. The lift follows the level joint, which follows the shoulder."""
LINKAGE = {"elbow": (0.0, 1.0, 0.0, 0.0, 0.0), "level": (0.0, -1.0, 0.0, 0.0, 0.0), "lift": (0.01, 0.05, 0.02, 0, 0)}


def palletizer(couplings: Mapping[str, Sequence[float]] = LINKAGE) -> Any:
    texts = {joint: " ".join(str(term) for term in terms) for joint, terms in couplings.items()}
    return mujoco.MjModel.from_xml_string(PALLETIZER.format(**texts))
