"""Faults of servos in words, as they are told to who wants to move the arm."""

from nodes.handling.robot import describe_faults


def test_a_fault_of_several_joints_is_said_once_and_a_joint_is_named_once() -> None:
    faults = {
        "joint1": "nobody answers on ./bus",
        "joint2": "joint2: servo 2 is hot",
        "joint3": "nobody answers on ./bus",
    }
    assert describe_faults(faults) == "joint1, joint3: nobody answers on ./bus; joint2: servo 2 is hot"
    assert describe_faults({}) == ""
