"""Programs on the command socket in campaigns: they send nonsense, stall and die, and the invariants hold."""

from pathlib import Path

import numpy as np
import pytest

from hal.types import FloatArray
from servoloop.campaign.campaign import files_of, require_possible_schedule, run_schedule_of, run_seed, schedule_of
from servoloop.campaign.contradictions import joints_and_hand
from servoloop.campaign.draws.clients import DRAWS, draw_client
from servoloop.campaign.scenario import Scenario
from servoloop.campaign.shrink import shrink
from servoloop.campaign.socket_clients import program as socket_program
from servoloop.campaign.socket_clients.nonsense import FAULTS
from servoloop.command_server import requests
from servoloop.simulation.acts import (
    Act,
    SocketDeath,
    SocketMove,
    SocketNonsense,
    SocketRequest,
    SocketStall,
    SocketStream,
)
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule, ScheduleError, read_schedule, schedule_text
from tests.servoloop.planted_bugs import BUGS

JOINT, TARGET = "joint6", 1.2
MOVE = SocketMove(at_s=0.2, positions={JOINT: TARGET}, seconds=1.5)
STREAM = SocketStream(at_s=0.2, positions={JOINT: TARGET}, for_s=1.0, closes=False)
PERIOD_S = 0.05
LEAD = 2.1
"""Acceleration of a command as a share of the joint's limit: the command leads its path by the lag of the servo."""
WATCHES = "ok"
"""First reply to each program, which watches the states of the arm."""
Replies = list[tuple[str, str]]


@pytest.fixture
def replies(monkeypatch: pytest.MonkeyPatch) -> Replies:
    """For each reply, its ID and the type of its error, or ``ok``."""
    found: Replies = []
    judge = socket_program.SocketProgram._judge

    def judged(program: socket_program.SocketProgram, reply: dict[str, object]) -> None:
        error = reply.get("error")
        found.append((str(reply["id"]), str(error["type"]) if isinstance(error, dict) else "ok"))
        judge(program, reply)

    monkeypatch.setattr(socket_program.SocketProgram, "_judge", judged)
    return found


def path_of(*acts: Act, seconds: float = 3.0) -> FloatArray:
    """Run actions, check that no invariant is violated, and return the command of the joint in each cycle, in rad."""
    commands: list[float] = []

    def prepare(stack: FaultyStack) -> None:
        place = stack.loop.hardware.command_interfaces.index(f"{JOINT}/position")
        stack.on_state = lambda state: commands.append(float(stack.loop.command[place])) if not stack.ending else None

    assert run_schedule_of(Schedule(seconds=seconds, backlash_deg=0.0, clients=acts), prepare).violations == ()
    return np.array(commands)


@pytest.mark.parametrize("op", ["move", "goal", "set_point"])
def test_a_motion_over_the_socket_reaches_its_target(op: str) -> None:
    path = path_of(MOVE.model_copy(update={"op": op}))
    assert path[-1] == pytest.approx(TARGET, abs=1e-6)


def test_every_nonsense_is_refused_and_moves_nothing(replies: Replies) -> None:
    acts = [SocketNonsense(at_s=0.2 + 0.1 * n, fault=fault) for n, fault in enumerate(FAULTS)]
    path = path_of(*acts)
    refused = [error for number, error in replies if number == "None" or number.startswith("invalid")]
    assert np.ptp(path) == 0.0
    assert len(refused) == len(FAULTS)
    assert set(refused) == {"malformed", "version", "input", "stale", "unknown", "too_large"}


@pytest.mark.parametrize(("act", "share"), [(MOVE, LEAD), (STREAM, 1.05)], ids=["move", "stream"])
@pytest.mark.parametrize("end", [SocketDeath(at_s=0.9), SocketDeath(at_s=0.9, half=True)], ids=["whole", "half"])
def test_the_motion_of_a_program_that_dies_slows_down_and_holds(act: Act, share: float, end: SocketDeath) -> None:
    path, limit = path_of(act, end), files_of("robot_arm").limits[JOINT]
    braking = np.diff(path[round(end.at_s / PERIOD_S) :], 2) / PERIOD_S**2
    assert path[0] + 0.1 < path[-1] < TARGET - 0.05 and np.ptp(path[-20:]) == 0.0
    assert -share * limit.acceleration <= braking.min() < -1.0


def test_a_stream_with_a_far_first_target_does_not_jump() -> None:
    path, limit = path_of(STREAM.model_copy(update={"leaps": True})), files_of("robot_arm").limits[JOINT]
    assert path[-1] == pytest.approx(TARGET, abs=1e-6)
    assert np.abs(np.diff(path, 2)).max() <= 1.001 * limit.acceleration * PERIOD_S**2


def test_a_stream_that_falls_silent_ends_within_its_age() -> None:
    path = path_of(STREAM.model_copy(update={"for_s": 0.4}), MOVE.model_copy(update={"at_s": 1.5}), seconds=4.0)
    assert np.ptp(path[25:29]) == 0.0 and path[-1] == pytest.approx(TARGET, abs=1e-6)


def test_a_program_that_stalls_within_a_message_moves_nothing_later(replies: Replies) -> None:
    path = path_of(SocketStall(at_s=0.2, positions={JOINT: TARGET}, for_s=0.8))
    assert np.ptp(path) == 0.0 and [error for _, error in replies] == [WATCHES, "ok", "stale"]
    path = path_of(SocketStall(at_s=0.2, positions={JOINT: TARGET}, for_s=0.3))
    assert path[-1] == pytest.approx(TARGET, abs=1e-6)


def test_a_second_owner_is_refused_until_it_seizes_the_motion(replies: Replies) -> None:
    second = SocketMove(at_s=0.4, connection=2, positions={JOINT: -TARGET})
    assert path_of(MOVE, second, seconds=4.0)[-1] == pytest.approx(TARGET, abs=1e-6)
    assert [error for _, error in replies] == [WATCHES, "ok", "ok", WATCHES, "owned", "not_owner"]
    seized = SocketRequest(at_s=0.4, connection=2, op="seize"), second.model_copy(update={"at_s": 0.5})
    assert path_of(MOVE, *seized, seconds=4.0)[-1] == pytest.approx(-TARGET, abs=1e-6)


def test_the_fault_of_a_dead_client_ends_all_connections(tmp_path: Path) -> None:
    file = tmp_path / "schedule.yaml"
    acts = (MOVE, MOVE.model_copy(update={"at_s": 1.2, "connection": 2}))
    file.write_text(schedule_text(Schedule(seconds=3.0, clients=acts)) + "faults: [{kind: client_dies, at_s: 0.8}]\n")
    report = run_schedule_of(read_schedule(file))
    assert report.violations == () and report.examined["cancels are followed"]


def test_equal_seeds_have_equal_runs_and_the_schedule_can_be_saved(tmp_path: Path) -> None:
    scenario = Scenario(clients=("sockets",), faults=1, within_s=2.0)
    assert run_seed(scenario, 6) == run_seed(scenario, 6)
    (tmp_path / "kept.yaml").write_text(schedule_text(schedule_of(scenario, 6)))
    assert read_schedule(tmp_path / "kept.yaml") == schedule_of(scenario, 6)


def test_the_seeds_of_the_program_draw_every_action_and_every_nonsense() -> None:
    arm = joints_and_hand(files_of("robot_arm"), None)
    acts = [act for seed in range(300) for act in draw_client("sockets", seed, *arm, 8.0)]
    assert {act.kind for act in acts} == {
        *("socket_move", "socket_stream", "socket_request", "socket_nonsense", "socket_stall", "socket_death")
    }
    assert {act.fault for act in acts if isinstance(act, SocketNonsense)} == set(FAULTS)
    assert "sockets" in DRAWS


@pytest.mark.parametrize(
    ("act", "message"),
    [
        ("{kind: socket_move, connection: 9, positions: {joint1: 0.1}}", "connection"),
        ("{kind: socket_nonsense, fault: poem}", "fault"),
        ("{kind: socket_stall, positions: {joint1: 0.1}, for_s: -1}", "for_s"),
        ("{kind: socket_stream, positions: {shoulder: 0.1}}", "the arm has no joint 'shoulder': choose one of joint1"),
        ("{kind: socket_death, at_s: 9}", "socket_death starts at 9 s, but the run ends after 2 s: start it earlier"),
    ],
    ids=["connection", "nonsense", "duration", "joint", "late"],
)
def test_a_bad_schedule_is_refused_with_its_line(tmp_path: Path, act: str, message: str) -> None:
    file = tmp_path / "schedule.yaml"
    file.write_text(f"seconds: 2\nclients:\n- {act}\n")
    with pytest.raises(ScheduleError) as refused:
        require_possible_schedule(file, read_schedule(file))
    assert str(refused.value).startswith(f"{file}:3: ") and message in str(refused.value)
    assert "\n" not in str(refused.value)


PLANTED = {
    "stale_commands_are_carried_out": (SocketStall(at_s=0.2, positions={JOINT: TARGET}, for_s=0.8), "goals are judged"),
    "silent_streams_continue": (STREAM.model_copy(update={"for_s": 0.4}), "every goal ends"),
    "motions_of_dead_programs_continue": (MOVE, "cancels are followed"),
}


@pytest.mark.parametrize("bug", PLANTED)
def test_a_planted_bug_is_found_and_its_schedule_minimized(bug: str, monkeypatch: pytest.MonkeyPatch) -> None:
    act, invariant = PLANTED[bug]
    acts = act, SocketRequest(at_s=0.5, op="state"), SocketDeath(at_s=1.4 if act is MOVE else 2.9)
    BUGS[bug][0](monkeypatch)

    def violates(schedule: Schedule) -> bool:
        return invariant in {one.invariant for one in run_schedule_of(schedule).violations}

    left = shrink(Schedule(seconds=3.0, backlash_deg=0.0, clients=acts), violates)
    assert left.clients == ((act, acts[2]) if act is MOVE else (act,))


def test_an_internal_error_of_the_server_is_a_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requests.StackRequests, "state", lambda requests: {}["state"])
    report = run_schedule_of(Schedule(seconds=1.0, clients=(SocketRequest(at_s=0.2, op="state"),)))
    (violation,) = report.violations
    assert violation.invariant == "no crash" and "internal error while handling" in violation.text
