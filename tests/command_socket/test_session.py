"""A session of the command server needs neither a thread nor a socket, and takes all times from one clock."""

import gc
import json
from typing import Any

import pytest

from controller.manager.switch import SwitchRequest
from servoloop.api.own_loop import describe
from servoloop.api.stack_backend import StackBackend
from servoloop.campaign.socket_clients.between_cycles import BetweenCycles
from servoloop.command_server import session as session_module
from servoloop.command_server.requests import StackRequests
from servoloop.command_server.session import Session
from servoloop.recording.stack_recording import StackRecording
from servoloop.simulation.stack import SimulatedStack
from sim_backend.packets.sts import Code
from tests.stack.rig import READY


class Client:
    """Client that accepts at most ``accepts`` bytes per call."""

    def __init__(self, runs_s: float = 0.1) -> None:
        """Connect to a stack after it has run for this time, in seconds."""
        self.stack = SimulatedStack(start=(*READY, 0.0)).up()
        time, control, recording = BetweenCycles(self.stack.loop), self.stack.control_stack, StackRecording(None)
        arm = StackBackend(control, describe(control), time, lambda: None, recording)
        self.requests = StackRequests(control, arm, recording, time)
        self.accepts, self.open, self.read = 1_000_000, True, bytearray()
        self.session = Session("client", self, self.requests)
        self.wait_s(runs_s)

    def send(self, data: bytes | bytearray) -> int:
        self.read += data[: self.accepts]
        return min(self.accepts, len(data))

    def shut(self) -> None:
        self.open = False

    def wait_s(self, seconds: float) -> None:
        """Let time pass."""
        self.stack.run(seconds)

    def line(self, op: str, **fields: Any) -> bytes:
        return json.dumps({"v": 1, "id": op, "op": op, **fields}).encode() + b"\n"

    def write(self, data: bytes) -> list[dict[str, Any]]:
        """Send bytes, and return all new replies."""
        self.session.receive(data)
        self.session.serve()
        return self.replies()

    def replies(self) -> list[dict[str, Any]]:
        lines, self.read = self.read.splitlines(), bytearray()
        return [json.loads(line) for line in lines]


@pytest.fixture
def client() -> Client:
    return Client()


@pytest.mark.parametrize(("pause_s", "outcome"), [(0.4, None), (0.6, "stale")])
def test_a_message_in_two_halves_is_carried_out_when_it_is_complete_unless_it_is_old(
    client: Client, pause_s: float, outcome: str | None
) -> None:
    assert client.write(client.line("take"))[0]["ok"]
    sent_s = client.requests.time.now()
    line = client.line("move", joints=["joint1"], times_s=[1.0], positions=[[0.4]], sent_s=sent_s)
    assert client.write(line[:40]) == []
    client.wait_s(pause_s)
    (reply,) = client.write(line[40:])
    assert reply.get("error", {}).get("type") == outcome
    client.wait_s(2.0)
    assert client.stack.loop.command[0] == pytest.approx(READY[0] if outcome else 0.4, abs=1e-3)


def test_a_client_that_watches_before_the_first_cycle_receives_states_afterward() -> None:
    client = Client(runs_s=0.0)
    client.write(client.line("watch", rate_hz=10.0))
    client.session.notify(client.requests.state)
    assert client.replies() == []
    client.wait_s(0.1)
    client.session.notify(client.requests.state)
    (state,) = client.replies()
    assert state["event"] == "state"


def test_messages_beyond_the_rate_wait_and_none_is_lost(client: Client) -> None:
    client.session.receive(client.line("hello") * (session_module.BURST + 100))
    left_s = client.session.serve()
    assert 0.0 < left_s < 0.001 and len(client.replies()) == session_module.BURST
    assert client.session.serve() == left_s and client.replies() == []
    client.wait_s(0.1)
    assert client.session.serve() == 0.0 and len(client.replies()) == 100


def test_a_client_that_does_not_read_is_disconnected(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "MAX_UNREAD_BYTES", 500)
    client.accepts = 0
    client.write(client.line("hello"))
    assert client.open and client.session.unsent
    client.write(client.line("hello") * 8)
    assert not client.open


def test_states_come_at_their_rate_by_the_clock(client: Client) -> None:
    client.write(client.line("watch", rate_hz=5.0))
    states = []
    for _ in range(20):
        client.wait_s(client.stack.loop.period_s)
        client.session.notify(client.requests.state)
        states += client.replies()
    assert len(states) == 5


def test_a_message_that_is_too_large_is_refused_with_all_later_messages(client: Client) -> None:
    (reply,) = client.write(b"x" * 500_001)
    assert reply["error"]["type"] == "too_large" and client.session.refused
    assert client.write(b"\n" + client.line("take")) == []


def test_a_streamed_target_is_in_the_goals_on_the_bus_within_one_cycle(client: Client) -> None:
    loop, joint = client.stack.loop, client.stack.files.robot.joints[0]

    def next_goal(after_s: float) -> tuple[float, int]:
        """Return the time of the next group write, in seconds, and the goal of the first servo in it, in counts."""
        sent = client.stack.port.sent
        time_s, data = next((at_s, data) for at_s, data in sent if at_s > after_s and data[4] == Code.SYNC_WRITE)
        return time_s, int.from_bytes(data[9:11], "little")  # the acceleration comes first

    client.write(client.line("take"))
    client.write(client.line("stream", max_age_s=1.0))
    for target in (0.01, 0.02, 0.03):
        now_s = client.requests.time.now()
        assert client.write(client.line("targets", positions={joint.name: target}, sent_s=now_s))[0]["ok"]
        client.wait_s(loop.period_s)
        written_s, goal = next_goal(now_s)
        assert written_s - now_s <= loop.period_s and goal == joint.counts(target)


def test_the_only_forward_controller_holds_when_a_client_that_did_not_name_it_dies(client: Client) -> None:
    loop = client.stack.loop
    loop.manager.switch(SwitchRequest((), ("arm_controller",)), loop.within_limits)
    client.write(client.line("take"))
    begin, now_s = loop.command[-1], client.requests.time.now()
    assert client.write(client.line("set_point", controller="", values=[0.05], sent_s=now_s))[0]["ok"]
    client.wait_s(0.2)
    assert loop.command[-1] > begin
    client.session.end()
    client.wait_s(2.0)
    assert begin < loop.command[-1] < 0.045


BAD_TIMES = {"joints": ["joint1"], "times_s": [1e9], "positions": [[0.0]], "sent_s": 0.0}
REFUSED = {
    "not JSON": b"{\n",
    "an unknown op": b'{"v": 1, "id": 1, "op": "dance"}\n',
    "an unknown field": b'{"v": 1, "id": 1, "op": "stop", "now": true}\n',
    "a time that is too long": json.dumps({"v": 1, "id": 1, "op": "move", **BAD_TIMES}).encode() + b"\n",
    "a time as text": json.dumps({"v": 1, "id": 1, "op": "move", **BAD_TIMES, "sent_s": "now"}).encode() + b"\n",
    "an arm without control": b'{"v": 1, "id": 1, "op": "torque", "on": true}\n',
}


@pytest.mark.parametrize("line", REFUSED.values(), ids=REFUSED.keys())
def test_the_error_of_a_refused_message_is_freed_without_a_garbage_collection(client: Client, line: bytes) -> None:
    """The stack does not run full garbage collections, which also cannot free what pydantic's errors refer to."""
    client.write(client.line("take"))
    assert not client.write(line)[0]["ok"]
    gc.collect()
    gc.disable()
    try:
        before = errors_in_memory()
        client.write(line)
        assert errors_in_memory() == before
    finally:
        gc.enable()


def errors_in_memory() -> int:
    return sum(issubclass(type(found), BaseException) for found in gc.get_objects())
