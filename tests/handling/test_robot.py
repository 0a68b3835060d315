"""Description of servo faults for a user who wants to move the arm."""

from servoloop.manual.joints_now import describe_faults


def test_same_fault_of_several_joints_is_listed_once() -> None:
    faults = {
        "joint1": "no servo responds on ./bus",
        "joint2": "joint2: servo 2 is hot",
        "joint3": "no servo responds on ./bus",
    }
    assert describe_faults(faults) == "joint1, joint3: no servo responds on ./bus; joint2: servo 2 is hot"
    assert describe_faults({}) == ""
