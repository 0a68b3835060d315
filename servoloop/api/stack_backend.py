"""Backend that controls the arm of a control stack in the same process, through the stack's controllers."""

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep
from typing import Any, Final, cast

import numpy as np

from controller.diagnostics import Level, health_status
from controller.forward.forward_command_controller import ForwardCommandController
from controller.gripper.gripper_action_controller import GripperActionController
from controller.interface import Controller, ControllerType
from controller.manager.switch import SwitchRequest
from controller.manager_errors import ManagerError
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.driver_errors import DriverError
from hal.types import FloatArray, Interface, JointState, joints_of
from servoloop.api.arm_errors import ArmBusyError, ArmError, ArmInputError, ArmTimeoutError, MotionFailedError
from servoloop.api.backend import ArmDescription, ArmState, MotionGoal, MotionProgress, Observer
from servoloop.api.checks import checked_goal, checked_targets
from servoloop.api.freedrive import Freedrive
from servoloop.api.hand_parts import ControllerAccess, start_forward, start_gripper
from servoloop.api.motions import FORWARD, GRIPPER, TRAJECTORY, MotionPart, RunningMotion, joints_of_mover
from servoloop.api.pace import POLL_S, Ended, LoopPace
from servoloop.api.stream_gate import StreamGate
from servoloop.api.targets import approach_s
from servoloop.api.torque import TorqueSwitch
from servoloop.api.trajectory_part import check_trajectory
from servoloop.api.user_controllers import active_controller, build_controller
from servoloop.recording.mcap import RecordingError
from servoloop.recording.recorder import CLOSE_S
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack.control_stack import ControlStack

ANSWER_S: Final = 5.0
"""Maximum time for the loop to serve a request, in seconds."""
FREEDRIVE_S: Final = 2.0
"""Maximum time to begin or end a freedrive, in seconds."""
PARK_S: Final = 60.0
"""Maximum time by which the motion to the park pose may exceed its planned duration, in seconds."""


class StackBackend:
    """Backend for a control stack whose loop runs in another thread or in simulated time.

    Create the backend before the loop starts. In each cycle, the backend first calls the loop's previous ``on_cycle``
    function.
    """

    def __init__(
        self, stack: ControlStack, arm: ArmDescription, pace: LoopPace, ended: Ended, recording: StackRecording
    ) -> None:
        """Connect to a stack.

        Args:
            stack: Control stack with its controllers.
            arm: Properties of the arm, from ``describe``.
            pace: Pace of the loop.
            ended: Function that returns the error of a loop that has ended, or None while the loop is running.
            recording: Recordings of the stack.
        """
        self._recording = recording
        self.stack, self.description = stack, arm
        self._pace, self._ended = pace, ended
        self._names = joints_of(stack.loop.hardware.command_interfaces)
        self._columns = [stack.loop.hardware.joints.index(joint) for joint in arm.joints]
        self._commands = [self._command_of(joint) for joint in arm.joints]
        self._latest: tuple[JointState, FloatArray] | None = None
        self._parts: tuple[MotionPart, ...] = ()
        self._lock = threading.RLock()
        self._stream = StreamGate(stack, arm.joints, self._in_loop)
        self._freedrive = Freedrive(stack, arm.joints, self._in_loop)
        self._torque = TorqueSwitch(stack, pace.wait, self._in_loop)
        shown = stack.loop.on_cycle

        def on_cycle(state: JointState) -> None:
            shown(state)
            self._on_cycle(state)

        stack.loop.on_cycle = on_cycle

    def state(self) -> ArmState:
        """Return the latest state."""
        if self._latest is None:
            self._pace.wait(lambda: self._latest is not None, ANSWER_S)
        if self._latest is None:
            raise self._ended() or ArmError("the arm has not sent any measurements: check its power and its cables")
        state, command = self._latest
        return self._converted(state, command)

    def observe(self, observer: Observer) -> Callable[[], None]:
        """Call a function with the latest state after each cycle, and return a function that stops the calls."""
        return self._pace.watch(lambda: observer(self.state()))

    def start(self, goal: MotionGoal) -> MotionProgress:
        """Start a motion, as ``ArmBackend.start`` describes."""
        goal = checked_goal(goal, self.description)
        with self._lock:
            self._require_free(goal.joints)
            movers = self._movers(goal.joints)
            starts = [self._check(controller, goal) for controller in movers]
            parts = tuple(start() for start in starts)  # All controllers have accepted the goal.
            if any(controller.kind.endswith(TRAJECTORY) for controller in movers):
                for part in parts:
                    part.begin_after_arm()
            for part in self._parts:
                if not part.done and any(part.controller.name == controller.name for controller in movers):
                    part.cancel(replaced=True)
            self._parts = (*(part for part in self._parts if not part.done), *parts)
        return RunningMotion(parts, self._ended)

    def cancel(self, progress: MotionProgress) -> None:
        """Cancel a motion of this backend."""
        with self._lock:
            for part in cast(RunningMotion, progress).parts:
                part.cancel()

    def stop(self) -> None:
        """Cancel all motions, including those of other clients, and end any stream and freedrive."""
        self.end_stream()
        self._freedrive.end()
        with self._lock:
            for part in self._parts:
                part.cancel()
            for entry in self.stack.loop.manager.registry.running:
                newest = getattr(entry.controller, "newest_goal", None)
                if newest is not None and not newest.done:
                    cast(JointTrajectoryController, entry.controller).cancel(newest)
                elif entry.controller.kind.endswith(FORWARD) and not entry.controller.settled():
                    self._brake(entry.spec.name)

    def begin_stream(self, max_age_s: float) -> None:
        """Open a stream, as ``ArmBackend.begin_stream`` describes."""
        if not (math.isfinite(max_age_s) and max_age_s > 0.0):
            raise ArmInputError(f"the maximum age of a target must be above 0 s, not {max_age_s}")
        with self._lock:
            self._require_rest("open a stream")
        self._stream.begin(max_age_s)

    def send(self, targets: Mapping[str, float]) -> None:
        """Send targets in rad or m, keyed by joint name."""
        self._stream.send(checked_targets(targets, self.description))

    def end_stream(self) -> None:
        """End the stream, if one is open."""
        self._stream.end()

    def set_torque(self, on: bool, park: bool = True) -> None:
        """Enable or disable the torque, as ``ArmBackend.set_torque`` describes."""
        if error := self._ended():
            raise error
        if on:
            self._torque.enable()
            return
        self.stop()
        self._pace.wait(lambda: not self._freedrive.open, FREEDRIVE_S)
        if park and self._torque.on:
            self._park()
        self._torque.release()

    def begin_freedrive(self) -> None:
        """Let a person move the joints, as ``ArmBackend.begin_freedrive`` describes."""
        with self._lock:
            self._require_rest("move the arm by hand")
        freedrive = self._freedrive
        try:
            freedrive.begin()
            self._pace.wait(lambda: freedrive.free or not freedrive.open, FREEDRIVE_S)
        except ArmBusyError:  # Another caller has opened the freedrive.
            raise
        except BaseException:  # The request to begin may still be waiting, so the request to end follows it.
            self.stack.loop.requests.ask(freedrive.end)
            raise
        if not freedrive.open:
            raise ArmError("the arm cannot be moved by hand: another program has activated its controllers")

    def end_freedrive(self) -> None:
        """Let the joints hold their positions, as ``ArmBackend.end_freedrive`` describes."""
        if self._ended():
            return
        freedrive = self._freedrive
        freedrive.end()
        if not self._pace.wait(lambda: not freedrive.open, FREEDRIVE_S):
            raise ArmTimeoutError(f"freedrive did not end within {FREEDRIVE_S:g} s, so the arm is still compliant")
        if soft := freedrive.soft:
            text = f"the torque of {', '.join(soft)} stays reduced until the servo responds: check the servo's cable"
            raise ArmError(text, soft[0])

    @contextmanager
    def record(self, path: Path) -> Iterator[None]:
        """Record all cycles in a new file for the duration of the context."""
        try:
            self._recording.begin(path)
        except DriverError as error:
            raise ArmInputError(str(error)) from None
        try:
            yield
        finally:
            self._end_recording(path)

    @contextmanager
    def controller(self, name: str, kind: ControllerType, parameters: Mapping[str, Any]) -> Iterator[Controller]:
        """Load a controller that drives its joints for the duration of the context.

        Raises ArmInputError or ArmBusyError.
        """
        with self._lock:
            self._require_free(())
        made = build_controller(self.stack, name, kind, parameters)
        with active_controller(self.stack, made, self._in_loop):
            yield made

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a condition."""
        return self._pace.wait(until, timeout_s)

    async def wait_async(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a condition without blocking the event loop."""
        return await self._pace.wait_async(until, timeout_s)

    def close(self) -> None:
        """Stop calling observers. The loop itself is ended by its owner."""
        self._pace.close()

    def _end_recording(self, path: Path) -> None:
        """End a recording, unless it has already ended with the loop. Raises ArmError if the file is incomplete."""
        if self._ended():
            return
        try:
            request = self._recording.end(path)
            deadline_s = monotonic() + CLOSE_S
            while not request.done and monotonic() < deadline_s:
                sleep(POLL_S)
            if not request.done:
                raise ArmError(
                    f"{path}: the disk did not respond for {CLOSE_S:.0f} s, so the recording may be incomplete"
                )
            request.result()
        except RecordingError as error:
            raise ArmError(str(error)) from error

    def _on_cycle(self, state: JointState) -> None:
        loop = self.stack.loop
        self._latest = state, loop.command
        for part in self._parts:
            part.update(state, state.stamp_s)
        self._stream.update(state.stamp_s)
        self._freedrive.update(state.faults, state.stamp_s)
        self._pace.cycle_done()

    def _check(self, controller: Controller, goal: MotionGoal) -> Callable[[], MotionPart]:
        """Check the part of a goal that a controller executes, and return a function that starts it.

        Raises ArmInputError.
        """
        if controller.kind.endswith(TRAJECTORY):
            return check_trajectory(cast(JointTrajectoryController, controller), goal)
        part = self._hand_part(controller, goal)
        return lambda: part  # The parts of hand controllers start in the next cycle.

    def _hand_part(self, controller: Controller, goal: MotionGoal) -> MotionPart:
        """Return the part of a goal that a hand controller executes. Raises ArmInputError."""
        loop = self.stack.loop
        held = np.array([loop.within_limits[self._command_of(joint)] for joint in joints_of_mover(controller)])
        if controller.kind.endswith(GRIPPER):
            return start_gripper(cast(GripperActionController, controller), goal, held)

        name, registry = controller.name, loop.manager.registry
        access = ControllerAccess(
            loop.period_s, lambda: any(one.spec.name == name for one in registry.running), lambda: self._brake(name)
        )
        return start_forward(cast(ForwardCommandController, controller), goal, held, access)

    def _brake(self, name: str) -> None:
        """Restart a controller, so that its joints first slow down within their limits.

        The call returns immediately.
        """
        loop = self.stack.loop
        request = SwitchRequest(activate=(name,), deactivate=(name,))
        loop.requests.ask(lambda: loop.manager.switch(request, loop.within_limits))

    def _movers(self, joints: tuple[str, ...]) -> list[Controller]:
        """Return the active controllers for these joints. Raises ArmBusyError if a joint has no active controller."""
        running = [entry.controller for entry in self.stack.loop.manager.registry.running]
        movers = [controller for controller in running if set(joints) & set(joints_of_mover(controller))]
        driven = {joint for controller in movers for joint in joints_of_mover(controller)}
        for joint in joints:
            if joint not in driven:
                claimed = self.stack.loop.manager.registry.claimed.get(f"{joint}/position")
                by = f"{claimed} drives it" if claimed else "no active controller moves it"
                raise ArmBusyError(f"{joint} cannot be moved: {by}. Activate its controller first", joint)
        return movers

    def _require_free(self, joints: Sequence[str]) -> None:
        """Raise ArmBusyError if a stream is open, or if these joints are in freedrive or their torque is off."""
        self._require_torque(joints)
        if self._stream.open:
            raise ArmBusyError("a stream is open: close it before you start a motion")
        if self._freedrive.open:
            raise ArmBusyError("the arm is in freedrive: end freedrive before you start a motion")

    def _require_rest(self, to: str) -> None:
        """Raise ArmBusyError unless the torque of all joints is on and there is no motion, stream or freedrive."""
        self._require_free(self.description.joints)
        if any(part.moves for part in self._parts):
            raise ArmBusyError(f"a motion is running: wait for it or call stop() before you {to}")

    def _require_torque(self, joints: Sequence[str]) -> None:
        if error := self._ended():
            raise error
        hardware = self.stack.loop.hardware
        for joint in joints:
            if not hardware.ready(str(Interface(joint, "position"))):
                lost = [one for one in hardware.lost if joint in one.hardware.joints]
                why = f"{lost[0].name} is lost ({lost[0].error})" if lost else "its torque is off"
                raise ArmBusyError(f"{joint} cannot be moved: {why}. Call arm.torque(True)", joint)

    def _park(self) -> None:
        """Move to the park pose specified in the robot file. Raises MotionFailedError."""
        park = self.stack.files.robot.file.park
        if park is None:
            return
        pose = {joint: at for joint, at in park.pose.items() if joint in self.description.joints}
        duration_s = approach_s(pose, self.state().command, self.description.limits, park.velocity_scale)
        progress = self.start(MotionGoal(tuple(pose), (duration_s,), (tuple(pose.values()),)))
        limit_s = duration_s + PARK_S
        ended = self.wait(lambda: progress.done, limit_s)
        if not ended:
            self.cancel(progress)
        failure = progress.failure if ended else ArmTimeoutError(f"the motion did not end within {limit_s:.1f} s")
        if failure is not None:
            raise MotionFailedError(
                f"the park pose was not reached, so the torque stays enabled: {failure}. Use torque(False, park=False) "
                "and hold the arm"
            ) from failure

    def _in_loop(self, action: Callable[[], None]) -> None:
        """Run an action between two cycles and raise any error that it causes."""
        request = self.stack.loop.requests.ask(action)
        if not request.done and not self._pace.wait(lambda: request.done, ANSWER_S):
            raise ArmError("the control loop does not respond: check whether its hardware hangs")
        try:
            request.result()
        except ArmError:
            raise
        except (ManagerError, DriverError, RuntimeError) as error:
            raise self._ended() or ArmError(str(error)) from error

    def _command_of(self, joint: str) -> int:
        return self.stack.loop.hardware.command_interfaces.index(str(Interface(joint, "position")))

    def _converted(self, state: JointState, command: FloatArray) -> ArmState:
        joints = self.description.joints

        def by_joint(values: FloatArray, columns: list[int]) -> dict[str, float]:
            return dict(zip(joints, values[columns].tolist(), strict=True))

        health = state.health
        return ArmState(
            state.stamp_s,
            max(0.0, self.stack.loop.clock.now() - state.stamp_s),
            by_joint(state.position, self._columns),
            by_joint(state.velocity, self._columns),
            by_joint(state.effort, self._columns),
            {joint: health[joint].temperature_c if joint in health else math.nan for joint in joints},
            by_joint(command, self._commands),
            _faults(state, joints),
            tuple(joint for joint in joints if joint in state.faults),
        )


def _faults(state: JointState, joints: tuple[str, ...]) -> dict[str, str]:
    """Return one sentence for each joint that has a fault or an alarm."""
    found = {}
    for joint in joints:
        if joint in state.faults:
            found[joint] = state.faults[joint].text
        elif joint in state.health:
            level, text = health_status(state.health[joint])
            if level is not Level.OK:
                found[joint] = text
    return found
