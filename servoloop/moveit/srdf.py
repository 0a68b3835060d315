"""The SRDF of an arm: groups, named states, end effector, and the links that need no check."""

from collections.abc import Mapping
from itertools import pairwise

from hal.robot_description.description import Description
from servoloop.moveit.collision_matrix import Pair, lines

GROUPS = ("arm", "hand")
States = Mapping[tuple[str, str], Mapping[str, float]]
"""Joint positions by group and name of the state."""


def tip(description: Description, joints: tuple[str, ...]) -> tuple[str, str] | None:
    """The first and the last link of a chain of joints; None if they are no chain."""
    moved = [description.joints[name] for name in joints]
    parents = {joint.child: joint.parent for joint in description.joints.values() if joint.kind == "fixed"}
    for before, after in pairwise(moved):
        parent = after.parent
        while parent != before.child and parent in parents:
            parent = parents[parent]
        if parent != before.child:
            return None
    return moved[0].parent, moved[-1].child


def followers(description: Description, hand: tuple[str, ...]) -> list[str]:
    """The joints that follow those of the hand."""
    return [j.name for j in description.joints.values() if j.mimic is not None and j.mimic.joint in hand]


def srdf(
    name: str,
    description: Description,
    groups: Mapping[str, tuple[str, ...]],
    states: States,
    unchecked: Mapping[Pair, str],
) -> str:
    """The whole file. ``groups``: the driven joints of ``arm`` and, if there is one, of ``hand``."""
    arm, hand = groups["arm"], groups.get("hand", ())
    chain = tip(description, arm)
    text = [
        '<?xml version="1.0"?>',
        "<!--",
        "  What MoveIt 2 must know of the arm beyond its URDF.",
        "  There is no virtual joint: the root link is where the arm stands, and the frame in which MoveIt plans.",
        "-->",
        f'<robot name="{name}">',
        '  <group name="arm">',
        *(
            [f'    <chain base_link="{chain[0]}" tip_link="{chain[1]}"/>']
            if chain
            else [f'    <joint name="{joint}"/>' for joint in arm]
        ),
        "  </group>",
    ]
    passive = followers(description, hand)
    if hand:
        text += [
            '  <group name="hand">',
            *(f'    <joint name="{joint}"/>' for joint in (*hand, *passive)),
            "  </group>",
        ]
    text.append("")
    for (group, state), positions in states.items():
        text.append(f'  <group_state name="{state}" group="{group}">')
        text += [f'    <joint name="{joint}" value="{position}"/>' for joint, position in positions.items()]
        text.append("  </group_state>")
    text.append("")
    if hand:
        parent = description.joints[hand[0]].parent
        text.append(f'  <end_effector name="hand" parent_link="{parent}" group="hand" parent_group="arm"/>')
    text += [f'  <passive_joint name="{joint}"/>' for joint in passive]
    text += [
        "",
        "  <!--",
        "    Computed by tools/collision_matrix.py. Adjacent: joined by a joint. Never: touch in none of its poses.",
        "    Always: touch in most of them. Default: touch at zero. User: driven as one, the links are there to meet.",
        "  -->",
        *lines(dict(unchecked)),
        "</robot>",
        "",
    ]
    return "\n".join(text)
