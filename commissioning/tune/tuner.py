"""Measure one joint while the arm holds all other joints, and write gains to the joint's servo while torque is off."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from typing import Final

from commissioning.provision import drives
from commissioning.slow_arm import SlowArm, StoppedError
from commissioning.tune.figures import JointFigures, TuneTrace, figures
from commissioning.tune.gains import TuneError, Written, as_held, read_gains, with_gains, write_gains
from commissioning.tune.trial import FASTEST_RAD_S, TrialPlan, TuneTrial, plan_for
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.driver_errors import ServoError
from drivers.types import ServoState
from hal.joint import Joint
from hal.servos.limp_arm import servo_name, torque_warning
from hal.types import FloatArray

OpenBuses = Callable[[Sequence[Joint]], Mapping[str, Bus]]
"""Function that opens the buses of the given joints and returns the buses, keyed by name. The joints' P gains may
differ from the robot file."""

PERIOD_S: Final = 0.02
TIMES: Final = 2
"""Number of steps to perform in each direction."""


@dataclass(frozen=True, slots=True)
class Ending:
    """State of the arm after a measurement."""

    relax: bool
    """Whether torque is disabled after the measurement. Otherwise, the arm holds its position."""
    park: Mapping[str, float] | None = None
    """Pose in which torque is disabled; None if the robot file does not define one."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """Measurement of a joint with its present gains."""

    gains: Mapping[str, int]
    plan: TrialPlan
    figures: JointFigures
    steps: tuple[TuneTrace, ...]
    sine: TuneTrace


class Tuner:
    """Tuner of one joint. The tuner opens the buses itself, and holds all joints of the arm during a measurement."""

    def __init__(
        self,
        joints: Sequence[Joint],
        name: str,
        open_buses: OpenBuses,
        clock: Clock,
        ending: Ending,
        signals: Callable[[], int] = lambda: 0,
    ) -> None:
        """Read the state of the arm without changing it. Raises TuneError, DriverError.

        Args:
            joints: All joints of the arm.
            name: Name of the joint to tune.
            open_buses: Function that opens the buses of the given joints.
            clock: Clock of the cycles.
            ending: State of the arm after a measurement.
            signals: Function that returns the number of signals received. After the first signal, the measurement stops
                and the arm is left in the state described by ``ending``. After the second signal, the remaining motion
                to the park pose and the gradual lowering of the arm are skipped.
        """
        if name not in (names := [joint.name for joint in joints]):
            raise TuneError(f"the arm has no joint {name}: choose one of {', '.join(names)}")
        self._open, self._clock, self._ending = open_buses, clock, ending
        self._signals = signals
        self._index = names.index(name)
        self._begun: FloatArray | None = None
        self.named = dict(joints[self._index].settings)
        """Settings of the joint in the robot file."""
        with self._buses(joints) as buses:
            self.joints = [_checked(buses[one.bus], one) for one in joints]
            self.gains = read_gains(buses[self.joint.bus], self.joint)
            """Present gains of the joint, keyed by name."""
            self.held = [servo_name(one) for one in joints if drives(buses[one.bus], one.servo_id, one.model)]
            """Names of the servos whose torque was enabled at the start."""
            self.position = _position(buses[self.joint.bus], self.joint)
            """Position of the joint at the start, in rad or m."""

    @property
    def joint(self) -> Joint:
        """The joint, with the settings of its servo."""
        return self.joints[self._index]

    def _stopped(self) -> bool:
        return self._signals() > 0

    @contextmanager
    def _buses(self, joints: Sequence[Joint]) -> Iterator[Mapping[str, Bus]]:
        buses = self._open(joints)
        with ExitStack() as stack:
            for bus in buses.values():
                stack.enter_context(closing(bus))
            yield buses

    def releases(self, writes: bool) -> str:
        """Return a warning about servos whose torque is enabled and will be disabled, or an empty string.

        Args:
            writes: Whether gains will be written, which requires torque to be off.
        """
        if not self.held or not (writes or self._ending.relax):
            return ""
        return f"Warning: this command disables the torque. {torque_warning(self.held)}."

    def check_write(self, wanted: bool) -> None:
        """Raise TuneError if gains could not be written, because no pose is known in which torque can be disabled."""
        if wanted and self.held and not self._ending.park:
            raise TuneError(
                "gains can be written only while the torque is disabled. The arm's torque is enabled, and the robot "
                "file has no park pose in which it can be disabled safely. Lay the arm down, disable its torque, and "
                "run this command again"
            )

    def measure(self, at: float | None, again: Callable[[Measurement], bool] = lambda found: False) -> Measurement:
        """Measure the joint, then leave the arm in the state described by ``ending``.

        Args:
            at: Position at which to measure, in rad or m; near the present position if None.
            again: Function that returns whether the joint will be measured again. If it returns True, torque is always
                disabled.

        Raises:
            TuneError: The joint does not follow its goals.
            StoppedError, DriverError, HalError: The measurement was stopped or failed.
        """
        arm = SlowArm(lambda: self._open(self.joints), self.joints, self._clock, self._signals, FASTEST_RAD_S, PERIOD_S)
        arm.relax = self._ending.relax
        with arm:
            try:
                found = self._measured(arm, at)
            except (StoppedError, TuneError):
                self._end(arm)  # This call stops immediately if a servo is still missing.
                raise
            arm.relax = again(found) or self._ending.relax
            self._end(arm)
        return found

    def write(self, values: Mapping[str, int]) -> tuple[Written, ...]:
        """Write gains to the joint's servo and return the changes. Torque must be off.

        Raises ServoError, StoppedError.
        """
        if self._stopped():
            raise StoppedError("stopped: nothing was written")
        with self._buses(self.joints) as buses:
            done = write_gains(buses[self.joint.bus], self.joint, values)
        self.joints[self._index] = with_gains(self.joint, values)
        self.gains = {**self.gains, **values}
        return done

    def _end(self, arm: SlowArm) -> None:
        """Move the joint back to its start, or move the arm to its park pose if its torque will be disabled.

        A second signal ends this motion early.
        """
        arm.stopped = lambda: count if (count := self._signals()) > 1 else 0
        target = arm.command.copy()
        if self._begun is not None:
            target[self._index] = self._begun[self._index]
        if arm.relax and self._ending.park:
            for index, joint in enumerate(arm.joints):
                target[index] = self._ending.park.get(joint.name, target[index])
        arm.go_all(target)

    def _measured(self, arm: SlowArm, at: float | None) -> Measurement:
        if self._begun is None:
            self._begun = arm.command.copy()
        arm.go_all(self._begun)
        plan = plan_for(self.joint, float(self._begun[self._index]), at)
        trial = TuneTrial(arm, self._index, plan)
        half_way = trial.look_for_room()
        steps = [trial.step(target) for _ in range(TIMES) for target in (plan.far, plan.near)]
        sine = trial.sine()
        count = abs(self.joint.units_per_count)
        found = figures(steps, sine, plan.sine_hz, count, half_way)
        return Measurement(dict(self.gains), plan, found, tuple(steps), sine)


def _checked(bus: Bus, joint: Joint) -> Joint:
    """Check the model of the joint's servo, and return the joint with the servo's settings."""
    try:
        bus.identify(joint.servo_id, joint.model)
        return as_held(bus, joint)
    except ServoError as error:
        raise TuneError(f"{joint.name}: {error}. Run `servoloop doctor` to find the cause") from error


def _position(bus: Bus, joint: Joint) -> float:
    reading = bus.read_states([joint.servo_id])[joint.servo_id]
    if not isinstance(reading, ServoState):
        raise TuneError(f"{joint.name}: {reading.text}")
    return joint.position(reading.position_counts)
