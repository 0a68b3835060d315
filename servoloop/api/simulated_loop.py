"""Control loop that a script runs in simulated time, with virtual servos in the same process."""

import logging
from pathlib import Path

from servoloop.api.arm_errors import ArmError
from servoloop.api.options import check_virtual_arm, setup_errors
from servoloop.api.own_loop import CLOSED, OwnLoop, describe, ended_by
from servoloop.api.pace import SimulatedPace
from servoloop.api.stack_backend import StackBackend
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack import hardware
from servoloop.stack.background_worker import SameThreadWorker
from servoloop.stack.robot_files import Files

LOG = logging.getLogger("servoloop")


class SimulatedLoop(OwnLoop):
    """Loop in simulated time, with virtual servos in this process. The cycles run while the program is waiting."""

    def __init__(self, files: Files, record: Path | None, seed: int | None, backlash_deg: float) -> None:
        """Start the loop. Raises ArmSetupError.

        Args:
            files: Files of the arm.
            record: Path of a new recording, if any.
            seed: Random seed for variations of the virtual arm. If None, the nominal arm is used.
            backlash_deg: Backlash of each servo, in degrees.
        """
        check_virtual_arm(seed, backlash_deg)
        super().__init__(files)
        self._failed = False
        recording = StackRecording(record)
        try:
            with setup_errors():
                self._start(recording, seed, backlash_deg)
        except BaseException:
            self._exit.close()
            raise

    def _start(self, recording: StackRecording, seed: int | None, backlash_deg: float) -> None:
        from servoloop.stack.virtual_lines import VirtualLines
        from sim_backend.buses.build import Build
        from sim_backend.clock import SimulatedClock

        files, clock = self._files, SimulatedClock()
        lines = VirtualLines(files, Build(backlash_deg, seed))
        setup = hardware.build(None, files, lines.devices, clock, lines, recording.tap)
        self._stack = stack = self._build(setup, clock, SameThreadWorker())
        self._exit.enter_context(stack.configured(self._initial.unconfigured))
        stack.loop.on_cycle = lambda state: lines.advance(clock.now())
        pace = SimulatedPace(stack.loop, self.ended, self._fail)
        self.backend = StackBackend(stack, describe(stack), pace, self.ended, recording)
        self._activate(stack, recording.of(stack.loop, files, 0.0, lambda: self._failed, setup.scene, live=False))
        self.world, self.lines = lines.world, lines.lines
        self.backend.state()  # This call runs the first cycle, so that the arm has a state.

    def _fail(self, error: Exception) -> None:
        """Shut the arm down after an error in the loop, like the loop thread does."""
        LOG.error("the control loop stops: %s", error)
        self._failed = True
        self._stack.end()
        self._why_ended = ended_by(error)

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        problems = [] if self._why_ended else self._stack.end()
        self._why_ended = self._why_ended or CLOSED
        self.backend.close()
        self._exit.close()
        if problems:
            raise ArmError(f"the arm was not shut down completely: {'; '.join(problems)}")
