"""Invariants on programs on the command socket: the messages that they receive, and their streams."""

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from controller.action_goals import GoalStatus
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from servoloop.api.stream_gate import STREAM
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.socket_clients.program import STATES_HZ
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.program_log import MotionKey

RESULT_CYCLES: Final = 2
"""Maximum number of cycles until a program receives the result of a motion that has ended."""
STATE_CYCLES: Final = 2
"""Maximum age of a state that a program receives, in cycles."""
LATE_CYCLES: Final = 3
"""Number of cycles by which a state may be late."""
ANSWER_S: Final = 0.5
"""Maximum time until the stack replies to a message, in seconds."""
KEPT: Final = 1e-3
"""Maximum change, in rad or m, of a joint's command if the stream does not name the joint."""


class ProgramsAreInformed(Invariant):
    """A program on the command socket promptly receives a reply to each message and the true result of each motion.

    It also receives the state of the latest cycle, and an event when it has lost control of the arm.
    """

    name = "programs are informed"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._log = stack.program_log
        self._shown = deque[tuple[JointState, dict[str, float]]](maxlen=STATE_CYCLES)
        """States and commands of the latest cycles."""
        self._cycles = Counter[MotionKey]()
        """Number of cycles since the goals of each motion have ended."""
        self._unseen = Counter[str]()
        """Number of cycles since each program last received a state."""
        self._owner = ""

    def on_state(self, state: JointState) -> None:
        clients = self.stack.clients
        if clients is None or clients.programs is None:
            return
        for program, event in self._log.events:
            if event["event"] == "state":
                self._unseen[program] = 0
            if event["event"] == "state" and self._shown:
                self._examine_state(event)
            elif event["event"] in ("moved", "result"):
                self._examine_result(program, event)
        for (program, number), sent_s in self._log.unanswered.items():
            if state.stamp_s - sent_s > ANSWER_S:
                self.say(f"{program} receives no reply to its message {number}")
        self._examine_watch()
        self._examine_owner(clients.programs.owner)
        self._log.events.clear()
        self._log.released.clear()
        for key, goals in self._log.motions.items():
            self._cycles[key] += all(goal.done for goal in goals)
            if self._cycles[key] > RESULT_CYCLES:
                self.say(f"{key[0]} does not receive the result of its {key[1]} {key[2]}")
        command = dict(zip(self.commanded, self.stack.loop.command.tolist(), strict=True))
        self._shown.append((state, command))

    def _examine_watch(self) -> None:
        """Check that each program that watches the arm receives states at its rate."""
        for program in self._log.watching:
            self._unseen[program] += 1
            if self._unseen[program] > 1.0 / (STATES_HZ * self.stack.loop.period_s) + LATE_CYCLES:
                self.say(f"{program} has received no state for {self._unseen[program]} cycles")
        for program in self._unseen.keys() - self._log.watching:
            del self._unseen[program]

    def _examine_state(self, event: Mapping[str, Any]) -> None:
        self.examined += 1
        found = [(state, command) for state, command in self._shown if state.stamp_s == event["time_s"]]
        if not found:
            self.say(f"programs receive the state of {event['time_s']:.3f} s, instead of the latest state")
            return
        state, command = found[0]
        joints = self.stack.loop.hardware.joints
        for field in ("position", "velocity", "effort"):
            true = dict(zip(joints, getattr(state, field).tolist(), strict=True))
            self._compare(field, event[field], true)
        self._compare("command", event["command"], command)
        unmeasured = {joint for joint in event["position"] if joint in state.faults}
        if set(event["unmeasured"]) != unmeasured or not unmeasured <= event["faults"].keys():
            self.say(
                f"programs are informed that {event['unmeasured']} are not measured, but in fact {sorted(unmeasured)}"
            )

    def _compare(self, field: str, received: Mapping[str, float | None], true: Mapping[str, float]) -> None:
        for joint, value in received.items():
            if value != (true[joint] if math.isfinite(true[joint]) else None):
                self.say(f"programs are informed that the {field} of {joint} is {value}, but it is {true[joint]}")

    def _examine_result(self, program: str, event: Mapping[str, Any]) -> None:
        kind = "motion" if event["event"] == "moved" else "goal"
        goals = self._log.motions.pop((program, kind, event[kind]), ())
        if not goals:
            return
        self.examined += 1
        text = f"{program} is informed about its {kind} {event[kind]}: {event.get('error', event.get('status'))}"
        if kind == "motion" and (event["error"] is None) != all(one.status is GoalStatus.SUCCEEDED for one in goals):
            self.say(f"{text}, but its goals ended as {', '.join(goal.status.name for goal in goals)}")
        elif kind == "goal":
            goal = goals[0]
            if (event["status"], event["code"], event["text"]) != (
                *(goal.status.value, goal.error_code, goal.error_text),
            ):
                self.say(f"{text}, but it ended as {goal.status.name}: {goal.error_text}")

    def _examine_owner(self, owner: str) -> None:
        former, self._owner = self._owner, owner
        if former in ("", owner) or former in self._log.released:
            return
        self.examined += 1
        if not any(program == former and event["event"] == "lost" for program, event in self._log.events):
            self.say(f"{former} is not informed that it has lost control of the arm")


class StreamsAreFollowed(Invariant):
    """A stream over the command socket moves only the joints that its targets name.

    The other joints keep their commands, unless they have a fault or return to their limits.
    """

    name = "streams are followed"
    promised = False

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._kept: dict[str, float] = {}
        """Commands of the joints that the stream has not named, when it began to drive the arm."""

    def on_state(self, state: JointState) -> None:
        manager, loop, clients = self.stack.manager, self.stack.loop, self.stack.clients
        if clients is None or clients.programs is None:
            return
        entry = manager.registry.loaded.get(STREAM)
        drives = self.active and entry is not None and entry.active and manager.cycle.at_rest(entry.index)
        if not drives or self.upset:
            self._kept.clear()
            return
        for joint, command, limit in zip(self.commanded, loop.command.tolist(), loop.limits, strict=True):
            kept = self._kept.setdefault(joint, command)
            moves = joint in self.stack.program_log.streamed or joint in state.faults
            if moves or not limit.lower <= kept <= limit.upper:
                del self._kept[joint]
                continue
            self.examined += 1
            if abs(command - kept) > KEPT:
                self.say(f"a stream moves {joint} from {kept:.4f} to {command:.4f}, but no target names this joint")
