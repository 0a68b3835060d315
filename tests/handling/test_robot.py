"""Message about faults of servos that prevent a motion."""

from nodes.handling.robot import in_words


def test_a_fault_of_several_joints_is_reported_once() -> None:
    faults = {
        "joint1": "nobody answers on ./bus",
        "joint2": "joint2: servo 2 is hot",
        "joint3": "nobody answers on ./bus",
    }
    assert in_words(faults) == "joint1, joint3: nobody answers on ./bus; joint2: servo 2 is hot"
    assert in_words({}) == ""
