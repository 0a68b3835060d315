"""The whole stack in simulated time with faults. The rig records everything that the stack reports."""

import logging
from collections.abc import Callable, Sequence
from functools import cache

from drivers.driver_errors import DriverError
from hal.types import JointState
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files
from sim_backend.faults.event import Event


@cache
def files_of(arm: str) -> Files:
    return read_arm_files(find_arm(arm))


class FaultRig(FaultyStack):
    """A stack with faults. ``said`` contains the reports of the stack in joint states, in the log, and at the end."""

    def __init__(self, arm: str = "robot_arm") -> None:
        super().__init__(files=files_of(arm), keep_alive=True)
        self.said: list[str] = []
        self.kinds: dict[str, set[str]] = {}
        """Kinds of faults reported in joint states, by joint."""
        self.alarms: dict[str, set[str]] = {}
        """Alarms in /diagnostics, by joint."""
        self.on_state = self._note

    def _note(self, state: JointState) -> None:
        for joint, fault in state.faults.items():
            if fault.kind not in self.kinds.setdefault(joint, set()):
                self.kinds[joint].add(fault.kind)
                self.say(f"{joint}: {fault.kind}: {fault.text}")
        for joint, health in state.health.items():
            for alarm in set(health.alarms) - self.alarms.setdefault(joint, set()):
                self.alarms[joint].add(alarm)
                self.say(f"{joint}: alarm: {alarm}")

    def say(self, text: str) -> None:
        self.said.append(f"{self.clock.now():.3f} {text}")

    def play(self, *events: Event) -> None:
        """Play events whose times are relative to the current world time."""
        self.player.play(events, self.world.time_s)

    def endure(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Run cycles for a given time, or until the loop ends with an error, which is then recorded as the last
        report."""
        handler, log = _Listener(self), logging.getLogger("servoloop")
        level = log.level
        log.addHandler(handler)
        log.setLevel(logging.INFO)
        try:
            self.run(seconds, until)
        except DriverError as error:
            self.say(f"ended: {error}")
        finally:
            log.removeHandler(handler)
            log.setLevel(level)

    def says(self, words: str) -> bool:
        return any(words in text for text in self.said)


class _Listener(logging.Handler):
    """Records every log message."""

    def __init__(self, rig: FaultRig) -> None:
        super().__init__(logging.INFO)
        self._rig = rig

    def emit(self, record: logging.LogRecord) -> None:
        self._rig.say(f"log: {record.getMessage()}")


BEFORE_S, MOVE_S, REACH_RAD = 0.2, 1.5, 0.3


def told(arm: str, event: Event, said: Sequence[str] = (), seconds: float = 3.0) -> FaultRig:
    """Inject ``event`` while the arm moves to a goal, until the stack has reported all texts in ``said``."""
    rig = FaultRig(arm)
    rig.up()
    rig.run(BEFORE_S)
    rig.play(event)
    here = rig.world.position()[: len(rig.arm.joints)]
    limits = rig.loop.limits
    handle = rig.go([min(max(p + REACH_RAD, b.lower), b.upper) for p, b in zip(here, limits, strict=False)], MOVE_S)
    rig.endure(seconds, lambda: bool(said) and all(map(rig.says, said)))
    rig.say(f"goal: {handle.status.name}: {handle.error_text}")
    for answer in rig.stack_faults.answers:
        rig.say(f"refused: {answer}" if answer else "taken")
    return rig
