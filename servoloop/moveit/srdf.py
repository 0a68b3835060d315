"""Generate the SRDF of an arm: groups, named states, end effector and disabled collision checks."""

from collections.abc import Mapping
from itertools import pairwise

from hal.robot_description.description import Description
from servoloop.motion_planning.collision_matrix import Pair, lines

GROUPS = ("arm", "hand")
States = Mapping[tuple[str, str], Mapping[str, float]]
"""Joint positions, keyed by group and state name."""


def tip(description: Description, joints: tuple[str, ...]) -> tuple[str, str] | None:
    """Return the first and the last link of a chain of joints, or None if the joints do not form a chain."""
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
    """Return the mimic joints of the hand."""
    return [j.name for j in description.joints.values() if j.mimic is not None and j.mimic.joint in hand]


def srdf(
    name: str,
    description: Description,
    groups: Mapping[str, tuple[str, ...]],
    states: States,
    unchecked: Mapping[Pair, str],
) -> str:
    """Return the SRDF file.

    Args:
        name: Name of the robot in the URDF.
        description: Robot description.
        groups: Driven joints of the ``arm`` group and, if there is a hand, of the ``hand`` group.
        states: Named states.
        unchecked: Pairs of links without collision checks, with the reasons.
    """
    hand = groups.get("hand", ())
    passive = followers(description, hand)
    parts = [
        _group_lines(tip(description, groups["arm"]), groups["arm"], (*hand, *passive)),
        [line for (group, state), positions in states.items() for line in _state_lines(group, state, positions)],
        _hand_lines(description, hand, passive),
    ]
    text = [
        '<?xml version="1.0"?>',
        "<!--",
        "  Information for MoveIt 2 that the URDF of the arm does not contain.",
        "  There is no virtual joint: MoveIt plans in the frame of the root link, on which the arm stands.",
        "-->",
        f'<robot name="{name}">',
        *(line for part in parts for line in (*part, "")),
        "  <!--",
        "    Computed by tools/collision_matrix.py. Adjacent: connected by a joint. Never: do not touch in any sampled",
        "    pose. Always: touch in most poses. Default: touch in the default pose. User: driven by one servo and",
        "    meant to touch.",
        "  -->",
        *lines(dict(unchecked)),
        "</robot>",
        "",
    ]
    return "\n".join(text)


def _group_lines(chain: tuple[str, str] | None, arm: tuple[str, ...], hand: tuple[str, ...]) -> list[str]:
    text = ['  <group name="arm">']
    if chain is not None:
        text.append(f'    <chain base_link="{chain[0]}" tip_link="{chain[1]}"/>')
    else:
        text += [f'    <joint name="{joint}"/>' for joint in arm]
    text.append("  </group>")
    if hand:
        text += ['  <group name="hand">', *(f'    <joint name="{joint}"/>' for joint in hand), "  </group>"]
    return text


def _state_lines(group: str, state: str, positions: Mapping[str, float]) -> list[str]:
    joints = [f'    <joint name="{joint}" value="{position}"/>' for joint, position in positions.items()]
    return [f'  <group_state name="{state}" group="{group}">', *joints, "  </group_state>"]


def _hand_lines(description: Description, hand: tuple[str, ...], passive: list[str]) -> list[str]:
    text = [f'  <passive_joint name="{joint}"/>' for joint in passive]
    if hand:
        parent = description.joints[hand[0]].parent
        text.insert(0, f'  <end_effector name="hand" parent_link="{parent}" group="hand" parent_group="arm"/>')
    return text
