"""Find the project files that a goal passes on its way to the bus, and those that a reply passes on its way up.

A file is on the path if one of its functions runs. Functions that run in the same cycle but are not on the path (other
controllers, the read before the write) are excluded, together with all functions that they call.
"""

import ast
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster
from controller.forward.forward_command_controller import ForwardCommandController
from controller.loop import ControlLoop
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.components.component_set import ComponentSet
from hal.servos.servo_faults import ServoFaults
from hal.servos.stall_watch import StallWatch
from hal.servos.supply_watch import SupplyWatch
from servoloop.recording.bus_tap import BusTap
from servoloop.simulation.stack import SimulatedStack
from tests.stack.rig import ARM, BINS, PICK, READY

ROOT = Path(__file__).parents[2]
ROOMS = ("drivers", "hal", "controller", "nodes", "servoloop")
"""Project folders whose files count. The simulation and the code that connects it do not count, because they replace
hardware. The recording code does not count, because it only observes.
"""

Function = Callable[..., Any]


class TripRecorder:
    """Recorder of project files, in the order in which their functions first run.

    The recorder covers the thread that starts it, and threads that start later.
    """

    def __init__(
        self, since: Function | None = None, until: Function | None = None, muted: Iterable[Function] = ()
    ) -> None:
        """Record from the first return of ``since`` (None: immediately) until the first call of ``until``."""
        self.files: list[str] = []
        self._since = since.__code__ if since else None
        self._until = until.__code__ if until else None
        self._muted = {function.__code__ for function in muted}
        self._names: dict[CodeType, str | None] = {}
        self._on, self._ended = since is None, False
        self._thread = threading.local()
        """``muted`` is the frame of the excluded function that the thread is executing, if any."""

    @contextmanager
    def recording(self) -> Iterator[None]:
        """Allow the recording to start while the context is active."""
        threading.setprofile(self._event)
        sys.setprofile(self._event)
        try:
            yield
        finally:
            sys.setprofile(None)
            threading.setprofile(None)

    def _event(self, frame: FrameType, event: str, _: Any) -> None:
        code, muted = frame.f_code, getattr(self._thread, "muted", None)
        if muted is not None:
            if event == "return" and frame is muted:
                self._thread.muted = None
        elif event == "call" and code in self._muted:
            self._thread.muted = frame
        elif event == "call" and code is self._until:
            self._ended = True
        elif event == "call" and self._on:
            self._note(code)
        elif event == "return" and code is self._since and not self._on:
            self._begin(frame)

    def _begin(self, frame: FrameType | None) -> None:
        """Add the files of the callers, which are also on the path."""
        self._on = True
        callers: list[CodeType] = []
        while frame is not None:
            callers.append(frame.f_code)
            frame = frame.f_back
        for code in reversed(callers):
            self._note(code)

    def _note(self, code: CodeType) -> None:
        if code not in self._names:
            self._names[code] = _project_file(code.co_filename)
        name = self._names[code]
        if name is not None and not self._ended and name not in self.files:
            self.files.append(name)


def _project_file(filename: str) -> str | None:
    path = Path(filename)
    if not path.is_relative_to(ROOT):
        return None
    relative = path.relative_to(ROOT)
    if any(relative.is_relative_to(room) for room in ("servoloop/simulation", "servoloop/recording")):
        return None
    return str(relative) if relative.parts[0] in ROOMS else None


def lines_of(files: Iterable[str]) -> int:
    """Return the number of lines of these files, without docstrings."""
    return sum(_code_lines((ROOT / name).read_text()) for name in files)


def _code_lines(text: str) -> int:
    bodies = [getattr(node, "body", None) for node in ast.walk(ast.parse(text))]
    texts = [
        part
        for body in bodies
        for part in (body if isinstance(body, list) else [])
        if isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant) and isinstance(part.value.value, str)
    ]
    return len(text.splitlines()) - sum((part.end_lineno or part.lineno) - part.lineno + 1 for part in texts)


ONE_POINT = TrajectoryGoal(ARM, (GoalPoint(PICK, 2.0),))
"""Goal of the pick-place node and of most clients."""
THREE_POINTS = TrajectoryGoal(ARM, tuple(GoalPoint(p, 2.0 * (i + 1)) for i, p in enumerate((PICK, BINS["A"], READY))))
"""Goal with waypoints, as sent by MoveIt."""


def goal_to_wire(rig: SimulatedStack, goal: TrajectoryGoal = ONE_POINT) -> list[str]:
    """Return the files from the submission of a goal to the first byte of its command, in the next cycle."""
    hand, broadcaster = ForwardCommandController, JointStateBroadcaster
    others: list[Function] = [ComponentSet.read, hand.update, hand.settled, broadcaster.update]
    others.append(StallWatch.goal)  # changes only the goals of joints that press
    trip = TripRecorder(until=BusTap.write, muted=others)
    with trip.recording():
        assert rig.arm.check(goal) is None
        rig.arm.submit(goal)
        rig.loop.step()
    return trip.files


def reply_to_joint_states(rig: SimulatedStack) -> list[str]:
    """Return the files from the first reply bytes of a cycle to the values published on /joint_states."""
    broadcaster = next(c for c in rig.manager.registry.controllers.values() if isinstance(c, JointStateBroadcaster))
    others: list[Function] = [JointTrajectoryController.update, ForwardCommandController.update, ControlLoop.send]
    others.append(ServoFaults.present)  # polls the torque of one servo at a time, which changes no joint state
    others.append(SupplyWatch.check)  # only reports
    trip = TripRecorder(since=BusTap.read, muted=others)
    with trip.recording():
        broadcaster.sample(rig.loop.step())
    return trip.files
