"""Handle the messages that move the arm as a whole, as ``servoloop.Arm`` does in the loop's process."""

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from itertools import count
from typing import Any

from drivers.paths import resolved
from servoloop.api.arm_errors import ArmError
from servoloop.api.backend import ArmBackend, MotionGoal, MotionProgress
from servoloop.api.socket_errors import command_error
from servoloop.command_server.ownership import Owner, Ownership
from servoloop.command_socket import messages
from servoloop.command_socket.command_errors import CommandError

LOG = logging.getLogger("servoloop")
Reply = dict[str, Any]


class ArmRequests:
    """Motions, streams and torque of the arm, for all clients. Any thread may call each method.

    ``handlers`` contains a function for each class of messages. The functions raise ArmError and CommandError.
    """

    def __init__(self, arm: ArmBackend) -> None:
        self._arm = arm
        self._ownership: Ownership | None = None
        self._lock = threading.RLock()
        self._motions: dict[Owner, dict[int, MotionProgress]] = {}
        self._streaming: Owner | None = None
        self._guiding: Owner | None = None
        """Client that started the freedrive of the arm."""
        self._numbers = count(1)
        self.handlers: Mapping[type[messages.Message], Callable[[Owner, Any], Reply]] = {
            messages.DescribeArm: self._describe,
            messages.MoveJoints: self._move,
            messages.CancelMove: self._cancel,
            messages.SendTargets: self._targets,
            messages.CloseStream: self._close_stream,
        }

    def state(self) -> Reply:
        """Return the latest state of the arm. Raises ArmError if there is no state yet."""
        return asdict(self._arm.state())

    def stop(self) -> None:
        """Stop all motions of the arm, including those of ROS clients."""
        self._arm.stop()
        self._streaming = self._guiding = None

    def open_stream(self, client: Owner, message: messages.OpenStream) -> None:
        """Open a stream, and wait for a cycle. Raises ArmError."""
        self._arm.begin_stream(message.max_age_s)
        self._streaming = client

    def set_torque(self, message: messages.Torque) -> None:
        """Enable or disable the torque, and wait until the change is complete. Raises ArmError."""
        self._arm.set_torque(message.on, message.park)

    def set_freedrive(self, client: Owner, on: bool) -> None:
        """Begin a freedrive, or end this client's freedrive, and wait until the change is complete. Raises ArmError."""
        if on:
            self._arm.begin_freedrive()
            self._guiding = client
        elif self._guiding is client:
            self._guiding = None
            self._arm.end_freedrive()

    def halt(self, client: Owner) -> None:
        """Cancel the motions of a client, and end its stream and its freedrive.

        The joints slow down within their limits and hold their positions.
        """
        with self._lock:
            if self._guiding is client:
                self.stop()
            for progress in self._motions.get(client, {}).values():
                self._arm.cancel(progress)
            if self._streaming is client:
                self._end_stream()

    def ended(self, client: Owner) -> Iterator[Reply]:
        """Yield, as an event, the result of each of a client's motions that has finished since the last call."""
        if client not in self._motions:
            return
        with self._lock:
            motions = self._motions[client]
            for number in [number for number, progress in motions.items() if progress.done]:
                failure = motions.pop(number).failure
                yield {"event": "moved", "motion": number, "error": None if failure is None else _as_dict(failure)}

    def forget(self, client: Owner) -> None:
        """Discard the data of a client that has disconnected. Call ``halt`` first."""
        with self._lock:
            self._motions.pop(client, None)

    def _describe(self, client: Owner, message: messages.DescribeArm) -> Reply:
        arm = self._arm.description
        return {**asdict(arm), "folder": None if arm.folder is None else str(resolved(arm.folder))}

    def _move(self, client: Owner, message: messages.MoveJoints) -> Reply:
        goal = MotionGoal(
            tuple(message.joints),
            tuple(message.times_s),
            tuple(map(tuple, message.positions)),
            tuple(map(tuple, message.velocities)),
        )
        with self._lock:
            number = next(self._numbers)
            self._motions.setdefault(client, {})[number] = self._arm.start(goal)
        return {"motion": number}

    def _cancel(self, client: Owner, message: messages.CancelMove) -> Reply:
        with self._lock:
            progress = self._motions.get(client, {}).get(message.motion)
            if progress is not None:  # a motion that has just finished is not affected
                self._arm.cancel(progress)
        return {}

    def _targets(self, client: Owner, message: messages.SendTargets) -> Reply:
        self._arm.send(message.positions)
        return {}

    def _close_stream(self, client: Owner, message: messages.CloseStream) -> Reply:
        with self._lock:
            if self._streaming is client:
                self._end_stream()
        return {}

    def _end_stream(self) -> None:
        self._streaming = None
        try:
            self._arm.end_stream()
        except ArmError as error:  # The loop brings the joints to rest before it ends.
            LOG.info("command socket: a client's stream ended because the control loop ended: %s", error)


def _as_dict(failure: Exception) -> Reply:
    error = command_error(failure) if isinstance(failure, ArmError) else CommandError("internal", str(failure))
    return error.as_dict()
