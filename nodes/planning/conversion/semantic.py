"""The SRDF of a robot as a string, for clients of move_group: groups, named states, end effectors and pairs."""

import xml.etree.ElementTree as ET

from planning.groups import Group, path_to
from planning.robot import PlanningRobot


def robot_name(robot: PlanningRobot) -> str:
    """Return the robot's name from its URDF."""
    return ET.fromstring(robot.description.xml).get("name", "")


def srdf_text(robot: PlanningRobot) -> str:
    """Return the robot's SRDF."""
    root = ET.Element("robot", name=robot_name(robot))
    for group in robot.groups.groups.values():
        _add_group(root, robot, group)
    for group in robot.groups.groups.values():
        for state, positions in group.states.items():
            added = ET.SubElement(root, "group_state", name=state, group=group.name)
            for joint, position in positions.items():
                ET.SubElement(added, "joint", name=joint, value=f"{position:.9g}")
    for effector in robot.groups.end_effectors.values():
        attributes = {"name": effector.name, "parent_link": effector.parent_link, "group": effector.group}
        if effector.parent_group:
            attributes["parent_group"] = effector.parent_group
        ET.SubElement(root, "end_effector", attributes)
    for name, moving in robot.description.joints.items():
        if moving.kind != "fixed" and moving.mimic is None and name not in robot.limits:
            ET.SubElement(root, "passive_joint", name=name)
    for one, other in sorted(robot.scene.allowed):
        ET.SubElement(root, "disable_collisions", link1=one, link2=other, reason="Default")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _add_group(root: ET.Element, robot: PlanningRobot, group: Group) -> None:
    added = ET.SubElement(root, "group", name=group.name)
    if group.tip is not None and (base := _chain_base(robot, group, group.tip)):
        ET.SubElement(added, "chain", base_link=base, tip_link=group.tip)
        return
    for name, joint in robot.description.joints.items():
        if name in group.joints or (joint.mimic is not None and joint.mimic.joint in group.joints):
            ET.SubElement(added, "joint", name=name)


def _chain_base(robot: PlanningRobot, group: Group, tip: str) -> str:
    """Return the first link of a group's chain that ends at ``tip``, or an empty string if the group is not such a
    chain."""
    if tip not in robot.description.links:
        return ""
    path = path_to(robot.description, tip)
    moving = [joint for joint in path if joint.kind != "fixed"]
    own = [joint for joint in moving if joint.name in group.joints]
    is_chain = len(own) == len(group.joints) and own == moving[len(moving) - len(own) :]
    return own[0].parent if own and is_chain else ""
