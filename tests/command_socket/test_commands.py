"""Clients of the command socket move a simulated arm through its controllers."""

import math
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from servoloop import Arm, ArmState
from servoloop.command_socket.client import CommandClient
from servoloop.command_socket.command_errors import CommandError
from tests.command_socket.rig import SocketRig, served, settle
from tests.servoloop.served import eventually
from tests.stack.rig import ARM, READY

TARGET = [*READY[:5], READY[5] + 0.3]


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[SocketRig]:
    with served(monkeypatch) as rig:
        yield rig


@pytest.fixture
def client(rig: SocketRig) -> Iterator[CommandClient]:
    with rig.client("test") as client:
        yield client


def goal(client: CommandClient, target: list[float] = TARGET, time_s: float = 1.0, **fields: object) -> int:
    points = [{"positions": target, "time_s": time_s}]
    return int(client.request("goal", **{"joints": ARM, "points": points, **fields})["goal"])


def refused(kind: str, words: str | None = None) -> "pytest.RaisesExc[CommandError]":
    return pytest.raises(CommandError, match=words, check=lambda error: error.kind == kind)


def test_hello_describes_the_arm(client: CommandClient, rig: SocketRig) -> None:
    assert client.arm["arm"] == "robot_arm" and client.arm["rate_hz"] == pytest.approx(20.0)
    arm = client.request("arm")
    assert arm["joints"] == [*ARM, "hand_right_joint"] and arm["hand"] == "hand_right_joint"
    assert arm["limits"]["joint1"]["upper"] == rig.stack.files.limits["joint1"].upper


def test_a_goal_is_reached_and_its_result_is_an_event(client: CommandClient, rig: SocketRig) -> None:
    client.request("take")
    result = settle(client, goal(client))
    assert result["status"] == "succeeded" and result["ok"] is True
    state = client.request("state")
    assert state["position"]["joint6"] == pytest.approx(TARGET[5], abs=0.05)
    assert state["faults"] == {} and state["owner"].startswith("test (process ")


def moved(client: CommandClient, motion: int) -> dict[str, object]:
    """Wait for the result of a motion."""
    found: list[dict[str, object]] = []

    def ended() -> bool:
        events = client.events(0.1)
        found.extend(event for event in events if event["event"] == "moved" and event["motion"] == motion)
        return bool(found)

    eventually(ended)
    return found[0]


def test_the_arm_moves_as_a_whole(client: CommandClient, rig: SocketRig) -> None:
    client.request("take")
    fields = {"joints": ["joint1", "hand_right_joint"], "times_s": [1.0], "positions": [[0.2, 0.02]]}
    assert moved(client, client.request("move", **fields)["motion"])["error"] is None
    state = client.request("state")
    assert state["position"]["joint1"] == pytest.approx(0.2, abs=0.02)
    with refused("input", "joint1"):
        client.request("move", joints=["joint1"], times_s=[1.0], positions=[[9.0]])
    motion = client.request("move", joints=["joint1"], times_s=[60.0], positions=[[0.9]])["motion"]
    client.request("cancel_move", motion=motion)
    assert moved(client, motion)["error"]["type"] == "motion_canceled"  # type: ignore[index]


def test_targets_are_followed_until_they_stop(client: CommandClient, rig: SocketRig) -> None:
    client.request("take")
    client.request("stream", max_age_s=5.0)
    client.request("targets", positions={"joint1": 0.05, "hand_right_joint": 0.01})
    eventually(lambda: rig.positions()[0] == pytest.approx(0.05, abs=1e-6))
    eventually(lambda: not rig.stack.loop.manager.registry.loaded["stream_controller"].active)
    with refused("stream_ended", r"no target arrived for 5 s"):
        client.request("targets", positions={"joint1": 0.05})
    client.request("stream_end")


def test_a_canceled_goal_brakes_and_holds(client: CommandClient, rig: SocketRig) -> None:
    client.request("take")
    number = goal(client, [*READY[:5], READY[5] + 1.0], 5.0)
    eventually(lambda: rig.positions()[5] > READY[5] + 0.05)
    client.request("cancel", goal=number)
    assert settle(client, number)["status"] == "canceled"
    held = rig.positions()
    time.sleep(0.2)
    np.testing.assert_allclose(rig.positions(), held, atol=0.01)
    assert held[5] < READY[5] + 0.9
    with refused("unknown", f"this client has no running goal {number}; running goals: none"):
        client.request("cancel", goal=number)


def test_a_stream_moves_the_arm_and_the_hand(client: CommandClient, rig: SocketRig) -> None:
    client.request("take")
    for share in np.linspace(0.0, 1.0, 30):
        client.request("set_point", controller="arm_controller", values=[*READY[:5], READY[5] + 0.3 * share])
        client.request("set_point", controller="hand_controller", values=[0.02 * share])
        time.sleep(0.01)
    eventually(lambda: abs(rig.positions()[5] - TARGET[5]) < 0.01 and abs(rig.stack.hand.command[0] - 0.02) < 1e-6)


def test_a_stream_that_is_released_brakes_within_the_limits_and_holds(client: CommandClient, rig: SocketRig) -> None:
    rig.pause_s = 0.05  # The release must arrive while the hand moves.
    client.request("take")
    client.request("set_point", controller="hand_controller", values=[0.05])
    hand: list[float] = []
    rig.stack.on_state = lambda state: hand.append(float(rig.stack.loop.command[6]))
    eventually(lambda: hand and hand[-1] > 0.005)
    client.request("release")
    eventually(lambda: len(hand) > 20 and len(set(hand[-5:])) == 1)
    assert hand[-1] < 0.049
    limit, period_s = rig.stack.files.limits["hand_right_joint"], rig.stack.loop.period_s
    braking = np.diff(hand, 2) / period_s**2
    assert braking.min() >= -1.1 * limit.acceleration


def test_controllers_are_listed_and_switched(client: CommandClient) -> None:
    def states() -> dict[str, str]:
        return {one["name"]: one["state"] for one in client.request("controllers")["controllers"]}

    assert states()["arm_controller"] == "active"
    with refused("not_owner"):
        client.request("switch", deactivate=["arm_controller"])
    client.request("take")
    client.request("switch", deactivate=["arm_controller"])
    assert states()["arm_controller"] == "inactive"
    with refused("unknown", r"no active trajectory controller moves joint1, .* \(none is active\)"):
        goal(client)
    with refused("rejected", "Controller is not running"):
        goal(client, controller="arm_controller")
    client.request("switch", activate=["arm_controller"])
    with refused("failed", "nope"):
        client.request("switch", activate=["nope"])


def test_torque_is_released_and_enabled(client: CommandClient, rig: SocketRig) -> None:
    with refused("not_owner"):
        client.request("torque", on=False)
    client.request("take")
    client.request("torque", on=False, timeout_s=20.0)
    with refused("busy", "its torque is off"):
        client.request("move", joints=["joint1"], times_s=[1.0], positions=[[0.1]])
    client.request("torque", on=True, timeout_s=20.0)
    settle(client, goal(client))


def test_a_recording_is_begun_and_ended(client: CommandClient, rig: SocketRig, tmp_path_factory: object) -> None:
    path = rig.running.socket.parent / "run.mcap"
    client.request("record", path=str(path))
    with refused("failed", "already exists"):
        client.request("record", path=str(path))
    with refused("failed", f"no client has started a recording in /nope.mcap; recordings started by clients: {path}"):
        client.request("record_end", path="/nope.mcap")
    time.sleep(0.2)
    client.request("record_end", path=str(path))
    assert path.stat().st_size > 1000
    with refused("malformed", "is not absolute"):
        client.request("record", path="run.mcap")


def test_states_arrive_while_they_are_watched(client: CommandClient) -> None:
    client.request("watch", rate_hz=1000.0)
    eventually(lambda: [event for event in client.events(0.1) if event["event"] == "state"])
    client.request("watch", rate_hz=0.0)
    client.events()
    assert not client.events(0.1)


def test_callbacks_are_not_called_after_the_end_of_a_connection(
    rig: SocketRig, caplog: pytest.LogCaptureFixture
) -> None:
    ready, entered, closed, states = threading.Event(), threading.Event(), threading.Event(), list[ArmState]()
    threads: list[threading.Thread] = []

    def wait(state: ArmState) -> None:
        if ready.is_set():
            threads.append(threading.current_thread())
            entered.set()
            closed.wait(20.0)

    with Arm.connect() as arm:
        arm.on_state(wait)
        arm.on_state(states.append)
        ready.set()
        assert entered.wait(20.0)
        states.clear()
    closed.set()
    threads[0].join(20.0)
    assert states == [] and "callback failed" not in caplog.text


def test_only_one_client_owns_the_motion(client: CommandClient, rig: SocketRig) -> None:
    with refused("not_owner", "send take first"):
        goal(client)
    client.request("take")
    goal(client, [*READY[:5], READY[5] + 1.0], 5.0)
    with rig.client("other") as other:
        with refused("owned", r"test \(process \d+\) has control of the arm"):
            other.request("take")
        with refused("not_owner", r"test \(process \d+\) has control"):
            goal(other)
        other.request("take", force=True)
        kinds = {event["event"]: event for event in client.events(2.0)}
        assert "other" in kinds["lost"]["text"]
        with refused("not_owner"):
            goal(client)
        goal(other)


def test_any_client_stops_all_motions(client: CommandClient, rig: SocketRig) -> None:
    client.request("take")
    number = goal(client, [*READY[:5], READY[5] + 1.0], 5.0)
    ros = rig.stack.go(READY)  # a goal of a client that does not use the socket
    with rig.client("other") as other:
        other.request("stop")
    settle(client, number)
    eventually(lambda: ros.done)
    with refused("not_owner"):
        goal(client)
    client.request("take")
    assert settle(client, goal(client))["ok"]


def test_the_result_of_a_stopped_goal_is_not_the_reply_to_a_later_message(
    client: CommandClient, rig: SocketRig
) -> None:
    client.request("take")
    number = goal(client, [*READY[:5], READY[5] + 1.0], 5.0)
    with rig.client("other") as other:
        other.request("take", force=True)
        other.request("watch", rate_hz=1000.0)
        eventually(lambda: [event for event in other.events(0.1) if event["event"] == "state"])
    assert client.request("state")["ok"]
    assert settle(client, number)["ok"] is False


MALFORMED = [
    (b"", "the message is not JSON"),
    (b"hello", "the message is not JSON"),
    (b"\xff\xfe", "the message is not JSON"),
    (b"[1]", "the message is not a JSON object"),
    (b'{"v":1,"id":7}', "op is 'None': use one of hello, state, watch"),
    (b'{"v":1,"id":7,"op":"fly"}', "op is 'fly': use one of"),
    (b'{"v":1,"id":7,"op":["stop"]}', "use one of"),
    (b'{"v":1,"op":"stop"}', "stop: id: is missing: add the key"),
    (b'{"v":1,"id":7,"op":"stop","now":1}', "stop: now: is not a known key: correct or remove it"),
    (b'{"v":1,"id":7,"op":"watch","rate_hz":"5"}', "watch: rate_hz: must be a number, not '5'"),
    (b'{"v":1,"id":7,"op":"watch","rate_hz":NaN}', "the message is not JSON"),
    (b'{"v":1,"id":7,"op":"grip","position":0.0}', "grip: sent_s: is missing: add the key"),
    (b'{"v":1,"id":7,"op":"cancel","goal":-1}', "cancel: goal: must be at least 0, not -1"),
    (b'{"v":1,"id":1.5,"op":"stop"}', "stop: id: must be a whole number, not 1.5"),
    (b'{"v":1,"id":7,"op":"grip","position":1e999,"sent_s":1}', ""),
    (b"[" * 5000, "the message is not JSON"),
]


@pytest.mark.parametrize(("line", "words"), MALFORMED)
def test_a_malformed_message_is_refused_and_the_connection_stays(
    line: bytes, words: str, client: CommandClient
) -> None:
    client._socket.sendall(line + b"\n")
    reply = client._next(5.0)
    assert reply is not None and reply["ok"] is False and reply["v"] == 1
    assert reply["error"]["type"] == "malformed" and words in reply["error"]["text"]
    assert reply["id"] == (7 if b'"id":7' in line else None)
    assert client.request("state")["ok"]


def test_another_version_is_refused(client: CommandClient) -> None:
    client._socket.sendall(b'{"v":2,"id":"x","op":"hello","new":true}\n')
    reply = client._next(5.0)
    assert reply is not None and (reply["id"], reply["error"]["type"]) == ("x", "version")
    assert reply["error"]["text"] == "the message has version 2: this stack uses version 1"
    assert client.request("state")["ok"]


def test_a_message_that_is_too_large_ends_the_connection(client: CommandClient, rig: SocketRig) -> None:
    with refused("too_large", "larger than 500000 bytes"):
        client.request("hello", client="x" * 3_000_000)
    with rig.client() as other:
        assert other.request("state")["ok"]


def test_stale_commands_move_nothing(client: CommandClient, rig: SocketRig) -> None:
    client.request("take")
    for sent_s, kind, words in (
        (time.monotonic() - 2.0, "stale", r"2\.\d\d s old"),
        (time.monotonic() + 2.0, "malformed", "in the future: use CLOCK_MONOTONIC"),
    ):
        with refused(kind, words):
            goal(client, sent_s=sent_s)
    np.testing.assert_allclose(rig.positions(), READY, atol=0.02)


def test_invalid_goals_are_refused_with_the_names_that_exist(client: CommandClient, rig: SocketRig) -> None:
    client.request("take")
    points = [{"positions": [0.0], "time_s": 1.0}]
    with refused("unknown", r"arm_controller does not move elbow; it moves joint1, joint2"):
        client.request("goal", controller="arm_controller", joints=["elbow"], points=points)
    with refused("unknown", r"no active trajectory controller moves elbow \(arm_controller: joint1, "):
        client.request("goal", joints=["elbow"], points=points)
    with refused("unknown", "there is no controller leg; the controllers for this message are: arm_controller"):
        client.request("goal", controller="leg", joints=["joint1"], points=points)
    with refused("rejected", "joint6"):
        goal(client, [*READY[:5], 99.0])
    with refused("malformed", "positions"):
        goal(client, [*READY[:5], math.nan])
    with refused("rejected", "does not match number of interfaces"):
        client.request("set_point", controller="hand_controller", values=[0.0, 0.0])
    np.testing.assert_allclose(rig.positions(), READY, atol=0.02)
