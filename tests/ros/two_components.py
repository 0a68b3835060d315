"""The URDF of the arm, with the arm and the hand as two hardware components."""

import re
from pathlib import Path

import yaml

from servoloop.stack.shipped_files import CONFIG, URDF

ARM = tuple(f"joint{i}" for i in range(1, 7))
HAND = "hand_right_joint"
MOCK = "<plugin>mock_components/GenericSystem</plugin>"
SERVOS = "<plugin>servoloop/ServoHardware</plugin>"
JOINT = """
    <joint name="{}">
      <command_interface name="position"/>
      <state_interface name="position"/>
      <state_interface name="velocity"/>
    </joint>"""
FOLLOWER = """
    <joint name="hand_left_joint">
      <state_interface name="position"/>
      <state_interface name="velocity"/>
    </joint>"""


def block(name: str, hardware: str, joints: str, attributes: str = "") -> str:
    """Return the XML of one ``<ros2_control>`` block."""
    return (
        f'<ros2_control name="{name}" type="system"{attributes}><hardware>{hardware}</hardware>{joints}</ros2_control>'
    )


def write_urdf(folder: Path, arm: str = MOCK, hand: str = MOCK) -> Path:
    """Write a URDF with ``arm`` and ``hand`` as the ``<hardware>`` of two blocks. The hand runs at half the rate."""
    blocks = block("arm", arm, "".join(map(JOINT.format, ARM)))
    blocks += block("hand", hand, JOINT.format(HAND) + FOLLOWER, ' rw_rate="10"')
    text, count = re.subn(r"<ros2_control.*</ros2_control>", blocks, URDF.read_text(), flags=re.DOTALL)
    assert count == 1
    path = folder / "two.urdf"
    path.write_text(text)
    return path


def write_robot_file(folder: Path, name: str, *joints: str) -> Path:
    """Write the part of the robot file that concerns these joints."""
    content = yaml.safe_load((CONFIG / "robot_arm.yaml").read_text())
    content["joints"] = {joint: content["joints"][joint] for joint in joints}
    content["park"] = {"pose": dict.fromkeys(joints, 0.0)}
    if not set(ARM) <= set(joints):
        del content["controller_defaults"]  # These belong to the arm.
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def servos(path: Path) -> str:
    """Return the ``<hardware>`` of servos with this robot file."""
    return f'{SERVOS}<param name="robot">{path}</param>'


def write_servos(folder: Path) -> Path:
    """Write the URDF with servos in both components. Each component has its own robot file and bus."""
    arm, hand = write_robot_file(folder, "arm", *ARM), write_robot_file(folder, "hand", HAND)
    return write_urdf(folder, servos(arm), servos(hand))


def add_states(urdf: Path, joint: str, *names: str) -> Path:
    """Additional state interfaces of a joint."""
    text, begin = urdf.read_text(), f'<joint name="{joint}">'
    assert text.count(begin) == 1
    urdf.write_text(text.replace(begin, begin + "".join(f'<state_interface name="{name}"/>' for name in names)))
    return urdf
