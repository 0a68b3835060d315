"""Messages about a goal of the planning server that a controller did not finish, without a middleware."""

from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("moveit_msgs")

from action_msgs.msg import GoalStatus

from controller.action_goals import GoalStatus as Decided
from nodes.controllers.action_goals import STOPPED, ActionGoals
from nodes.planning.controllers import ActionController
from nodes.planning.routes import Route

BY_CLIENT = (
    "arm_controller did not finish the motion: its goal was canceled by another client, such as servoloop stop: "
    "send it again"
)
NO_REASON = (
    "arm_controller did not finish the motion: its goal was aborted, for example by servoloop stop: "
    "check the log of the stack"
)


@pytest.mark.parametrize(
    ("status", "text", "said"),
    [
        (GoalStatus.STATUS_CANCELED, "", BY_CLIENT),
        (GoalStatus.STATUS_ABORTED, "", NO_REASON),
        (GoalStatus.STATUS_ABORTED, "it was blocked", "arm_controller did not finish the motion: it was blocked"),
        (GoalStatus.STATUS_SUCCEEDED, "", ""),
    ],
)
def test_an_unfinished_motion_is_reported_with_its_reason(status: int, text: str, said: str) -> None:
    controller: Any = object.__new__(ActionController)
    controller.route = Route("arm_controller", "trajectory", ("joint1",))
    assert controller._reason(SimpleNamespace(status=status, result=SimpleNamespace(error_string=text))) == said


class FakeGoal:
    """Goal that is no longer canceling after its end, as in rclpy."""

    goal_id = SimpleNamespace(uuid=b"1")

    def __init__(self, requested: bool) -> None:
        self.is_cancel_requested, self.end = requested, ""

    def canceled(self) -> None:
        self.is_cancel_requested, self.end = False, "canceled"

    def abort(self) -> None:
        self.end = "aborted"


@pytest.mark.parametrize(("requested", "said"), [(False, STOPPED), (True, "")])
def test_a_goal_that_another_client_canceled_is_reported_as_stopped(requested: bool, said: str) -> None:
    goals: Any = object.__new__(ActionGoals)
    goals._undecided, goals._handles = {}, {b"1": SimpleNamespace(status=Decided.CANCELED)}
    goals._result = lambda _: SimpleNamespace(error_string="")
    server_goal = FakeGoal(requested)
    with pytest.raises(StopIteration) as ended:
        goals.execute(server_goal).send(None)
    assert (ended.value.value.error_string, server_goal.end) == (said, "canceled" if requested else "aborted")
