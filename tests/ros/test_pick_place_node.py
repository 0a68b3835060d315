"""The pick-and-place node over ROS: its names, goals and failures."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock

from tests.ros.fake_arm import SILENT_SERVO, Plan
from tests.ros.pick_place_cell import FEEDBACK, STORY, Cell, wait_until
from tests.ros.stack_process import StackProcess, until

NODE = "vision_pick_place_controller"
JOINTS = ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"]
READY = [0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828]
PICK = [0.0, -0.35, -0.70, -0.70, -1.10, 1.55]
BIN = {
    "A": [0.4, -0.2, -0.8, -0.6, -1.1, 1.55],
    "B": [0.0, -0.2, -0.8, -0.6, -1.1, 1.55],
    "C": [-0.4, -0.2, -0.8, -0.6, -1.1, 1.55],
}
SUCCEEDED = GoalStatus.STATUS_SUCCEEDED
CANCELED = GoalStatus.STATUS_CANCELED
ABORTED = GoalStatus.STATUS_ABORTED
# Number of states published while the n-th motion runs.
TOLD = [2, 5, 8, 10]


@pytest.fixture(scope="module")
def shared_cell(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """Provide one node for most of the tests. Discovery is complete when no message of a whole job has been lost."""
    parameters = Path(__file__).parents[2] / "config" / f"{NODE}.yaml"
    log = tmp_path_factory.mktemp("node") / "log"
    with Cell(ros_domain, log, ["--ros-args", "--params-file", str(parameters)]) as cell:
        wait_until(lambda: _nothing_lost(cell), "a whole job")
        yield cell
        assert "Traceback" not in cell.log()


def _nothing_lost(cell: Cell) -> bool:
    cell.clear()
    pick = cell.pick("B")
    pick.end()
    time.sleep(0.2)
    return (pick.phases(), cell.phases(), len(cell.below().hand)) == (FEEDBACK, STORY, 3)


@pytest.fixture
def cell(shared_cell: Cell) -> Cell:
    shared_cell.forget()
    return shared_cell


def positions(cell: Cell) -> list[list[float]]:
    """Return the goals of the arm."""
    return [list(goal.trajectory.points[0].positions) for _, goal in cell.below().goals]


def assert_it_works_again(cell: Cell) -> None:
    """Check that the node accepts and completes a new job."""
    cell.forget()
    assert cell.pick("A").end()[0] == SUCCEEDED


# --- names and types ---------------------------------------------------------------------------


def test_node_has_its_names_and_types(cell: Cell) -> None:
    graph = cell.node
    published = dict(graph.get_publisher_names_and_types_by_node(NODE, "/"))
    assert published["/sorting/arm/state"] == ["std_msgs/msg/String"]
    assert published["/hand_controller/commands"] == ["std_msgs/msg/Float64MultiArray"]
    subscribed = dict(graph.get_subscriber_names_and_types_by_node(NODE, "/"))
    assert subscribed["/sorting/perception/apple_quality"] == ["apple_quality_msgs/msg/AppleQualityArray"]
    services = dict(graph.get_service_names_and_types_by_node(NODE, "/"))
    assert services["/sorting/arm/enable"] == ["std_srvs/srv/SetBool"]
    goal = "sorting_arm_interfaces/action/PickPlace_SendGoal"
    assert services["/sorting/arm/pick_place/_action/send_goal"] == [goal]
    clients = dict(graph.get_client_names_and_types_by_node(NODE, "/"))
    goal = "control_msgs/action/FollowJointTrajectory_SendGoal"
    assert clients["/arm_controller/follow_joint_trajectory/_action/send_goal"] == [goal]


# --- a job that works --------------------------------------------------------------------------


@pytest.mark.parametrize("grade", ["A", "B", "C"])
def test_goals_equal_those_of_the_table(cell: Cell, grade: str) -> None:
    status, result = cell.pick(grade).end()
    assert (status, result.success) == (SUCCEEDED, True)
    assert positions(cell) == [READY, PICK, BIN[grade], READY]
    for _, goal in cell.below().goals:
        assert list(goal.trajectory.joint_names) == JOINTS
        (point,) = goal.trajectory.points
        assert not point.velocities and not point.accelerations and not point.effort
        assert (point.time_from_start.sec, point.time_from_start.nanosec) == (2, 0)
        stamp = goal.trajectory.header.stamp
        assert (stamp.sec, stamp.nanosec) == (0, 0)


def test_gripper_commands_are_sent_between_the_motions(cell: Cell) -> None:
    arm = cell.below()
    cell.pick("B").end()
    wait_until(lambda: len(arm.hand) == 3, "the gripper commands")
    assert [value for _, value in arm.hand] == [[0.0], [0.05], [0.0]]
    for index, (sent_ns, _) in enumerate(arm.hand):
        assert arm.ended_ns[index] < sent_ns < arm.goals[index + 1][0]


def test_states_and_feedback_are_published(cell: Cell) -> None:
    pick = cell.pick("C")
    _, result = pick.end()
    cell.wait_for_end()
    assert cell.phases() == STORY
    wait_until(lambda: len(pick.phases()) >= len(FEEDBACK), "the feedback")
    assert pick.phases() == FEEDBACK
    assert {feedback.request_id for feedback in pick.feedback} == {result.request_id}
    first = cell.states[0]
    assert list(first) == ["seq", "request_id", "ts", "phase", "ok", "message", "grade"]
    assert [state["seq"] for state in cell.states] == list(range(first["seq"], first["seq"] + 12))
    assert {state["request_id"] for state in cell.states} == {result.request_id}
    assert {(state["ok"], state["grade"]) for state in cell.states} == {(True, "C")}
    assert abs(first["ts"] - time.time()) < 600.0


def test_numbers_continue_from_job_to_job(cell: Cell) -> None:
    first, second = (cell.pick("B").end()[1].request_id for _ in range(2))
    assert second == first + 1
    wait_until(lambda: cell.phases() == STORY * 2, "both stories")
    seq = [state["seq"] for state in cell.states]
    assert seq == list(range(seq[0], seq[0] + 24))


@pytest.mark.parametrize("grade", ["b", "  B ", "\tb\n"])
def test_grade_is_normalized(cell: Cell, grade: str) -> None:
    assert cell.pick(grade).end()[0] == SUCCEEDED
    assert positions(cell)[2] == BIN["B"]


# --- goals that must not run -------------------------------------------------------------------


def test_unknown_grade_is_accepted_and_aborted(cell: Cell) -> None:
    status, result = cell.pick("q").end()
    assert (status, result.success) == (ABORTED, False)
    assert "'Q'" in result.message and "A, B, C" in result.message
    cell.wait_for_end()
    assert cell.phases() == ["start", "error"]
    assert positions(cell) == []


@pytest.mark.parametrize("grade", ["", "  \t"])
def test_empty_grade_is_rejected(cell: Cell, grade: str) -> None:
    before = cell.log().count("the grade is empty")
    assert not cell.pick(grade).accepted
    cell.wait_for_log("the grade is empty", before + 1)


def test_goal_while_busy_is_rejected(cell: Cell) -> None:
    cell.forget(Plan.HOLD)
    first = cell.pick("A")
    cell.wait_for_goals(1)
    assert not cell.pick("B").accepted
    cell.wait_for_log("goal rejected: busy with job")
    first.cancel()
    assert first.end()[0] == CANCELED


def test_disabled_node_finishes_its_job_but_starts_none(cell: Cell) -> None:
    running = cell.pick("A")
    try:
        answer = cell.enable(False)
        assert answer.success and "disabled" in answer.message
        assert not cell.pick("B").accepted
        assert running.end()[0] == SUCCEEDED
        assert not cell.pick("B").accepted
        cell.wait_for_log("goal rejected: disabled")
        cell.see("B")
        cell.wait_for_log("vision message ignored: disabled")
    finally:
        assert cell.enable(True).success
    assert_it_works_again(cell)


# --- cancel ------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", range(4))
def test_cancel_in_every_motion(cell: Cell, motion: int) -> None:
    cell.forget(*[Plan.SUCCEED] * motion, Plan.HOLD)
    pick = cell.pick("B")
    cell.wait_for_goals(motion + 1)
    pick.cancel()
    status, result = pick.end()
    assert (status, result.success, result.message) == (CANCELED, False, "canceled")
    cell.wait_for_end()
    assert cell.phases() == [*STORY[: TOLD[motion]], "error"]
    assert (cell.states[-1]["ok"], cell.states[-1]["message"]) == (False, "canceled")
    assert (cell.below().canceled, len(cell.below().goals)) == (1, motion + 1)
    assert_it_works_again(cell)


def test_cancel_right_after_the_goal(cell: Cell) -> None:
    cell.forget(*[Plan.HOLD] * 4)
    pick = cell.pick("B")
    pick.cancel()
    assert pick.end()[0] == CANCELED
    assert_it_works_again(cell)


def test_cancel_before_the_arm_has_responded(cell: Cell) -> None:
    cell.forget(Plan.ANSWER_LATE)
    pick = cell.pick("B")
    cell.wait_for_goals(1)
    pick.cancel()
    cell.below().go_on()
    assert pick.end()[0] == CANCELED
    assert cell.below().canceled == 1
    assert_it_works_again(cell)


# --- an arm that fails -------------------------------------------------------------------------


@pytest.mark.parametrize("motion", range(4))
@pytest.mark.parametrize(("plan", "words"), [(Plan.ABORT, SILENT_SERVO), (Plan.REJECT, "rejected")])
def test_failure_in_every_motion(cell: Cell, motion: int, plan: Plan, words: str) -> None:
    cell.forget(*[Plan.SUCCEED] * motion, plan)
    pick = cell.pick("B")
    status, result = pick.end()
    assert (status, result.success) == (ABORTED, False)
    assert words in result.message
    cell.wait_for_end()
    assert cell.phases() == [*STORY[: TOLD[motion]], "error"]
    assert cell.states[-1]["message"] == result.message
    wait_until(lambda: pick.phases()[-1:] == ["error"], "the error as feedback")
    assert_it_works_again(cell)


# --- vision ------------------------------------------------------------------------------------


def test_fresh_apple_starts_a_job(cell: Cell) -> None:
    cell.see("", " c", "A")
    cell.wait_for_end()
    assert cell.phases() == STORY
    assert positions(cell) == [READY, PICK, BIN["C"], READY]


def test_apple_while_busy_waits_for_the_next_message(cell: Cell) -> None:
    cell.forget(Plan.HOLD)
    pick = cell.pick("A")
    cell.wait_for_goals(1)
    cell.see("C")
    pick.cancel()
    assert pick.end()[0] == CANCELED
    assert_it_works_again(cell)
    assert BIN["C"] not in positions(cell)


@pytest.mark.parametrize(
    ("grades", "age_s", "words"),
    [
        (["A"], 2.0, "s old; the maximum age is 1 s"),
        (["A"], 2e9, "s old; the maximum age is 1 s"),  # The stamp is negative.
        (["A"], None, "no stamp"),
        (["A"], -60.0, "in the future"),
        (["", " "], 0.0, "none of its apples has a grade"),
        ([], 0.0, "none of its apples has a grade"),
    ],
)
def test_stale_or_empty_vision_message_is_ignored(
    ros_domain: int, tmp_path: Path, grades: list[str], age_s: Any, words: str
) -> None:
    # One node per message, because the node does not log repetitions.
    with Cell(ros_domain % 100 + 1, tmp_path / "log") as cell:
        cell.see_until(lambda: words in cell.log(), *grades, age_s=age_s)
        assert cell.states == []


def test_vision_can_be_switched_off(ros_domain: int, tmp_path: Path) -> None:
    arguments = ["--ros-args", "-p", "auto_goal_from_vision:=false"]
    with Cell(ros_domain % 100 + 1, tmp_path / "log", arguments) as cell:
        cell.see_until(lambda: cell.sights == 10, "A")
        assert cell.pick("B").end()[0] == SUCCEEDED  # The node does not reject the goal because it is busy.
        assert BIN["A"] not in positions(cell)


# --- time-outs and the end ---------------------------------------------------------------------

IMPATIENT = [
    "--ros-args", "-p", "server_timeout_s:=1.5", "-p", "goal_timeout_s:=1.5",
    "-p", "result_timeout_s:=1.5", "-p", "cancel_timeout_s:=1.5",
]  # fmt: skip


@pytest.fixture(scope="module")
def impatient(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """Run a node with short timeouts, so that the tests are fast."""
    log = tmp_path_factory.mktemp("impatient") / "log"
    with Cell((ros_domain + 1) % 100 + 1, log, IMPATIENT) as cell:
        wait_until(lambda: _nothing_lost(cell), "a whole job")
        yield cell


def test_arm_that_does_not_respond_aborts_the_job(impatient: Cell) -> None:
    impatient.forget(Plan.ANSWER_LATE)
    status, result = impatient.pick("B").end()
    assert status == ABORTED
    assert "did not respond" in result.message
    impatient.below().go_on()
    wait_until(lambda: impatient.below().canceled == 1, "the cancel of the late goal")
    assert_it_works_again(impatient)


def test_arm_that_does_not_finish_is_canceled(impatient: Cell) -> None:
    impatient.forget(Plan.HOLD)
    status, result = impatient.pick("B").end()
    assert status == ABORTED
    assert "did not finish" in result.message
    wait_until(lambda: impatient.below().canceled == 1, "the cancel")
    assert_it_works_again(impatient)


def test_motion_timeout_follows_simulated_time(ros_domain: int, tmp_path: Path) -> None:
    arguments = ["--ros-args", "-p", "use_sim_time:=true", "-p", "result_timeout_s:=0.5"]
    with Cell(ros_domain % 100 + 1, tmp_path / "log", arguments) as cell:
        clock = cell.node.create_publisher(Clock, "/clock", 10)
        wait_until(lambda: clock.get_subscription_count() > 0, "the node's clock")
        time_s = 1000

        def advance_to_the_end() -> bool:
            nonlocal time_s
            time_s += 1
            clock.publish(Clock(clock=Time(sec=time_s)))
            time.sleep(0.05)
            return "error" in cell.phases()

        clock.publish(Clock(clock=Time(sec=time_s)))
        cell.forget(Plan.HOLD)
        pick = cell.pick("B")
        cell.wait_for_goals(1)
        time.sleep(1.0)  # twice the timeout, while the clock stands still
        assert "error" not in cell.phases()
        wait_until(advance_to_the_end, "the time-out")
        assert "did not finish" in pick.end()[1].message
        assert cell.states[-1]["ts"] >= 1000.5


ANSWERED_S = 1.0
"""Time for the node to receive the response to its goal, in seconds. The response may be lost if its sender ends
earlier."""


@pytest.mark.parametrize("canceled", [False, True], ids=["in a motion", "behind a cancel"])
def test_job_ends_when_the_arm_and_its_simulated_clock_are_gone(
    ros_domain: int, tmp_path: Path, canceled: bool
) -> None:
    with Cell(ros_domain % 100 + 1, tmp_path / "log", ["--ros-args", "-p", "use_sim_time:=true"]) as cell:
        cell.forget(Plan.REFUSE_CANCEL if canceled else Plan.HOLD)
        pick = cell.pick("B")
        cell.wait_for_goals(1)
        time.sleep(ANSWERED_S)
        if canceled:
            pick.cancel()
            wait_until(lambda: cell.below().canceled == 1, "the cancel")
        cell.lose_arm()
        status, result = pick.end()
        assert status == (CANCELED if canceled else ABORTED)
        assert "/arm_controller/follow_joint_trajectory disappeared" in result.message
        assert cell.pick("B").end()[0] == ABORTED, "the node is not busy with the lost job"


def test_arm_that_does_not_stop_is_reported(impatient: Cell) -> None:
    impatient.forget(Plan.REFUSE_CANCEL)
    pick = impatient.pick("B")
    impatient.wait_for_goals(1)
    pick.cancel()
    status, result = pick.end()
    impatient.below().go_on()
    assert status == CANCELED
    assert "did not confirm that it stopped" in result.message
    assert_it_works_again(impatient)


def test_missing_arm_is_reported(ros_domain: int, tmp_path: Path) -> None:
    with Cell(ros_domain % 100 + 1, tmp_path / "log", arm=False) as cell:
        status, result = cell.pick("B").end()
        assert status == ABORTED
        assert "/arm_controller/follow_joint_trajectory is not available" in result.message
        pick = cell.pick("B")
        pick.cancel()
        assert pick.end()[0] == CANCELED


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signal_cancels_the_goal_of_the_arm_and_ends_the_node(ros_domain: int, tmp_path: Path, number: int) -> None:
    with Cell(ros_domain % 100 + 1, tmp_path / "log") as cell:
        cell.forget(Plan.HOLD)
        pick = cell.pick("B")
        cell.wait_for_goals(1)
        cell.process.send_signal(number)
        status, result = pick.end()
        assert (status, result.message) == (ABORTED, "canceled: the node is stopping")
        assert cell.process.wait(30.0) == 0
        assert cell.below().canceled == 1
        assert "Traceback" not in cell.log()


@pytest.mark.slow
def test_invalid_parameters_are_named(ros_domain: int) -> None:
    command = [sys.executable, "-m", "nodes.vision_pick_place_controller", "--ros-args"]
    command += ["-p", "grades:=[A, D]", "-p", "poses.pick:=[1.0]"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "'bins.D' is missing" in done.stderr
    assert "Traceback" not in done.stderr


NODE_NAME = "vision_pick_place_controller"
GIVEN = [
    (
        "/**:\n  ros__parameters:\n    poses: {ready: [0, -0.35, 0.1, 0.0, 0.0, 0.0]}\n",
        "write each number of the list with",
    ),
    (f"{NODE_NAME}:\n  ros__parameters: {{move_times_s: 3.0}}\n", "parameter 'move_times_s' is ignored"),
    ("other_node:\n  ros__parameters: {move_time_s: 3.0}\n", f"given.yaml contains no parameters for /{NODE_NAME}"),
]
"""Content of a parameter file, and the expected warning or error."""


@pytest.mark.slow
@pytest.mark.parametrize(("text", "words"), GIVEN, ids=["mixed list", "misspelled key", "another node"])
def test_useless_parameter_file_is_reported(ros_domain: int, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "given.yaml").write_text(text)
    command = ["--ros-args", "--params-file", str(tmp_path / "given.yaml")]
    node = StackProcess(tmp_path / "node.log", *command, module=f"nodes.{NODE_NAME}")
    try:
        until(lambda: words in node.words)
        assert "Traceback" not in node.words
    finally:
        node.end()
