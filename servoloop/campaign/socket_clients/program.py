"""Program that is connected to the command socket of a simulated stack.

The program has neither a thread nor a socket.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from typing import Any, Final

from controller.trajectory.goal import GoalHandle
from hal.types import joints_of
from servoloop.campaign.socket_clients.nonsense import line_of, nonsense
from servoloop.command_server.requests import STALE_S, StackRequests
from servoloop.command_server.session import Session
from servoloop.simulation.acts import (
    STREAM_AGE_S,
    SocketAct,
    SocketDeath,
    SocketMove,
    SocketNonsense,
    SocketRequest,
    SocketStall,
    SocketStream,
)
from servoloop.simulation.faulty_stack import FaultyStack

SET_POINT_S: Final = 0.3
"""Time until the arm is at rest at a set point, in seconds."""
STATES_HZ: Final = 10.0
"""Rate at which programs receive the state of the arm, in states per second."""
INVALID: Final = "invalid"
"""Prefix of the ID of a message that the stack must reject."""


@dataclass(slots=True)
class ServedPrograms:
    """Stack that programs are connected to, and the results of all programs."""

    stack: FaultyStack
    requests: StackRequests
    last_target_s: float = -math.inf
    """Time of the latest target that the stack has accepted, or of the opening of the stream, in seconds."""
    defects: list[str] = field(default_factory=list)
    """IDs of the messages to which the stack has replied with an internal error."""


class SocketProgram:
    """Program at one end of a connection. The server's session is at the other end."""

    def __init__(self, number: int, served: ServedPrograms) -> None:
        """Connect to a stack. ``number`` is the number of the connection."""
        self.name = f"program {number}"
        self.open = True
        self._served, self._stack, self._now = served, served.stack, served.requests.time.now
        self._session = Session(self.name, self, served.requests)
        self._unread = b""
        """Beginning of a message that the stack has not sent completely."""
        self._begun = b""
        """Beginning of a message that the program has not sent completely."""
        self._numbers = count(1)
        self._goals: list[GoalHandle] = []
        """Goals that the program has sent to controllers."""
        self._running: dict[str, Any] = {}
        """Fields of the message that cancels the latest motion."""
        self._denied = False
        """Whether the latest reply said that another program has control of the arm."""
        self._stream: Iterator[None] = iter(())
        self._log = self._stack.program_log
        self._rest: tuple[float, bytes] | None = None
        """Second half of a message, and the time at which the program sends it."""
        self._actions: Mapping[type[SocketAct], Callable[[Any], None]] = {
            SocketMove: self._move,
            SocketStream: self._begin_stream,
            SocketRequest: self._request,
            SocketNonsense: self._send_nonsense,
            SocketStall: self._stall,
            SocketDeath: self._die,
        }
        self._ask("watch", rate_hz=STATES_HZ)
        self._log.watching.add(self.name)

    def send(self, data: bytes | bytearray) -> int:
        """Receive bytes from the stack; the session uses this method as its transport."""
        self._unread += data
        return len(data)

    def shut(self) -> None:
        """Close the connection; the session uses this method as its transport."""
        self.open = False

    def carry_out(self, act: SocketAct) -> None:
        """Perform an action unless the program is stalled."""
        if self._rest is None:
            self._actions[type(act)](act)

    def cycle(self) -> None:
        """Resume the program after a cycle, and read the replies."""
        if self._rest is not None and self._now() >= self._rest[0]:
            rest, self._rest = self._rest[1], None
            self._write(rest)
        if self._rest is None:
            next(self._stream, None)
        self._serve()
        self._session.notify(self._served.requests.state)
        self._read()
        if self.open and self._session.refused:
            self.hang_up()

    def hang_up(self) -> None:
        """End the connection. The server ends the program's motions."""
        self.open = False
        self._log.hang_up(self.name)
        self._expect_end(self._goals)
        self._session.end()

    def _move(self, act: SocketMove) -> None:
        self._write(self._motion(self._number(), act))

    def _motion(self, number: int | str, act: SocketMove) -> bytes:
        """Request control of the arm, and return the message for a motion.

        If another program keeps control of the arm, the stack must refuse the motion.
        """
        self._take()
        if self._denied:
            number = f"{INVALID}-{number}"
        names, values = list(act.positions), list(act.positions.values())
        sent_s, arm = self._now(), self._stack.arm
        if act.op == "move":
            return line_of(number, "move", joints=names, times_s=[act.seconds], positions=[values], sent_s=sent_s)
        whole = self._whole(act.positions)
        if act.op == "goal":
            points = [{"positions": list(whole.values()), "time_s": act.seconds}]
            return line_of(number, "goal", joints=list(whole), points=points, sent_s=sent_s)
        values = list(whole.values())
        return line_of(number, "set_point", controller=arm.name, values=values, time_s=act.seconds, sent_s=sent_s)

    def _begin_stream(self, act: SocketStream) -> None:
        self._take()
        if act.op == "targets":
            self._ask("stream", max_age_s=STREAM_AGE_S)
        self._stream = self._targets(act)

    def _targets(self, act: SocketStream) -> Iterator[None]:
        """Send one target after each cycle."""
        start, begun_s, now = self._whole({}), self._now(), self._now
        while (passed_s := now() - begun_s) < act.for_s:
            share = 1.0 if act.leaps else passed_s / act.for_s
            targets = {joint: start[joint] + share * (at - start[joint]) for joint, at in act.positions.items()}
            if act.op == "targets":
                self._log.streamed |= targets.keys()
                self._ask("targets", positions=targets, sent_s=now())
            else:
                values = list((start | targets).values())
                arm = self._stack.arm.name
                self._ask("set_point", controller=arm, values=values, time_s=SET_POINT_S, sent_s=now())
            yield
        if act.op == "targets" and act.closes:
            self._ask("stream_end")

    def _request(self, act: SocketRequest) -> None:
        if act.op == "seize":
            self._ask("take", force=True)
        elif act.op == "freedrive":
            self._take()
            self._ask("freedrive", on=True)
        elif act.op == "freedrive_end":
            self._ask("freedrive", on=False)
        elif act.op != "cancel":
            if act.op in ("release", "stop"):
                self._expect_end(self._goals if act.op == "release" else self._all_goals())
            if act.op == "release":
                self._log.released.add(self.name)
            self._ask(act.op)
        elif self._running:
            self._ask(**self._running)

    def _send_nonsense(self, act: SocketNonsense) -> None:
        self._take()
        limits = {joint: self._stack.files.limits[joint] for joint in self._stack.arm.joints}
        self._write(nonsense(act.fault, f"{INVALID}-{self._number()}", limits, self._now()))

    def _stall(self, act: SocketStall) -> None:
        late = f"{INVALID}-" if act.for_s > STALE_S else "slow-"
        line = self._motion(f"{late}{self._number()}", SocketMove(positions=act.positions))
        self._write(line[: len(line) // 2])
        self._rest = self._now() + act.for_s, line[len(line) // 2 :]

    def _die(self, act: SocketDeath) -> None:
        if act.half:
            # The command of a joint that was never measured is NaN, so the half message has other positions.
            line = self._motion(self._number(), SocketMove(positions=dict.fromkeys(self._stack.arm.joints, 0.0)))
            self._write(line[: len(line) // 2])
        self.hang_up()

    def _take(self) -> None:
        """Request control of the arm. The stack must refuse this request while another program has control."""
        owned = self._served.requests.ownership.owner not in ("", self.name)
        self._write(line_of(f"{INVALID}-{self._number()}" if owned else self._number(), "take"))

    def _number(self) -> int:
        return next(self._numbers)

    def _ask(self, op: str, **fields: Any) -> None:
        number = f"{op}-{self._number()}" if op in ("stream", "targets") else self._number()
        self._write(line_of(number, op, **fields))

    def _write(self, data: bytes) -> None:
        """Send bytes to the stack, which immediately processes complete messages."""
        lines, self._begun = _complete(self._begun + data)
        self._log.unanswered |= {(self.name, number): self._now() for number in _numbers(lines)}
        self._session.receive(data)
        self._serve()

    def _serve(self) -> None:
        """Let the stack handle the messages, and read the replies."""
        before = len(self._stack.goals.goals)
        self._session.serve()
        goals = tuple(one.handle for one in self._stack.goals.goals[before:])
        self._goals += goals
        self._read(goals)

    def _all_goals(self) -> list[GoalHandle]:
        """Return the unfinished goals of all clients."""
        return [one.handle for one in self._stack.goals.open]

    def _expect_end(self, goals: Iterable[GoalHandle]) -> None:
        """Log that goals must end now, as if their clients had canceled them."""
        for handle in goals:
            self._stack.goals.canceled(handle)

    def _read(self, goals: tuple[GoalHandle, ...] = ()) -> None:
        """Read all replies and events. The replies belong to messages that started ``goals``."""
        lines, self._unread = _complete(self._unread)
        messages = [json.loads(line) for line in lines]
        self._log.events += [(self.name, message) for message in messages if "event" in message]
        replies = [message for message in messages if "event" not in message]
        for reply in replies:
            self._log.unanswered.pop((self.name, str(reply["id"])), None)
            self._judge(reply)
        started = [(kind, reply[kind]) for reply in replies for kind in ("motion", "goal") if kind in reply]
        if len(started) == 1 and goals:
            self._log.motions[(self.name, *started[0])] = goals

    def _judge(self, reply: dict[str, Any]) -> None:
        number, error = str(reply["id"]), reply.get("error")
        self._denied = error is not None and error["type"] == "owned"
        if error is not None and error["type"] == "internal":
            self._served.defects.append(number)
        if number.startswith(INVALID):
            self._stack.stack_faults.answers.append(None if error is None else error["text"])
        elif error is None and number.startswith(("stream-", "targets-")):
            self._served.last_target_s = self._now()
            if number.startswith("stream-"):
                self._log.streamed.clear()
        elif "motion" in reply:
            self._running = {"op": "cancel_move", "motion": reply["motion"]}
        elif "goal" in reply:
            self._running = {"op": "cancel", "goal": reply["goal"]}

    def _whole(self, positions: Mapping[str, float]) -> dict[str, float]:
        """Return the positions of all joints of the arm. A joint without a given position keeps its command."""
        loop = self._stack.loop
        held = dict(zip(joints_of(loop.hardware.command_interfaces), loop.within_limits.tolist(), strict=True))
        return {joint: positions.get(joint, held[joint]) for joint in self._stack.arm.joints}


def _complete(data: bytes) -> tuple[list[bytes], bytes]:
    """Split bytes into complete lines and the beginning of the next line."""
    *lines, rest = data.split(b"\n")
    return [line for line in lines if line], rest


def _numbers(lines: Iterable[bytes]) -> Iterator[str]:
    """Yield the ID of each message that has one."""
    for line in lines:
        with suppress(ValueError):
            message = json.loads(line)
            if isinstance(message, dict) and "id" in message:
                yield str(message["id"])
