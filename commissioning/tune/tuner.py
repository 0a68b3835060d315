"""The tuner of one joint: the arm is held, the joint moved, the arm left as it is to be; gains go to a limp servo."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from typing import Final

from commissioning.provision import drives
from commissioning.slow_arm import SlowArm, StoppedError
from commissioning.tune.figures import Figures, Trace, figures
from commissioning.tune.gains import TuneError, Written, as_held, read_gains, with_gains, write_gains
from commissioning.tune.trial import FASTEST_RAD_S, Plan, Trial, plan_for
from drivers.bus.bus import Bus
from drivers.bus.types import ServoState
from drivers.clock import Clock
from drivers.errors import ServoError
from hal.joint import Joint
from hal.servos.limp_arm import servo_name, torque_warning
from hal.types import FloatArray

OpenBuses = Callable[[Sequence[Joint]], Mapping[str, Bus]]
"""Opens the buses of these joints, by name, with the P gains that live in RAM."""

PERIOD_S: Final = 0.02
TIMES: Final = 2
"""Steps in either direction."""


@dataclass(frozen=True, slots=True)
class Ending:
    """How the arm is left: let down, at ``park`` where the robot file has a pose, or held."""

    relax: bool
    park: Mapping[str, float] | None = None


@dataclass(frozen=True, slots=True)
class Measurement:
    """A joint as it was measured with its gains, by name."""

    gains: Mapping[str, int]
    plan: Plan
    figures: Figures
    steps: tuple[Trace, ...]
    sine: Trace


class Tuner:
    """The tuner of one joint holds all joints of the arm while it measures. One thread; it opens its buses itself."""

    def __init__(
        self,
        joints: Sequence[Joint],
        name: str,
        open_buses: OpenBuses,
        clock: Clock,
        ending: Ending,
        stopped: Callable[[], bool] = lambda: False,
        hurry: Callable[[], bool] = lambda: False,
    ) -> None:
        """Look at the arm: nothing is written, and torque stays as it is. Raises TuneError, DriverError.

        ``stopped`` ends it with the arm left as ``ending`` says; ``hurry`` skips the way to the park pose.
        """
        if name not in (names := [joint.name for joint in joints]):
            raise TuneError(f"the arm has no joint {name}, but {', '.join(names)}")
        self._open, self._clock, self._ending = open_buses, clock, ending
        self._stopped, self._hurry = stopped, hurry
        self._index = names.index(name)
        self._begun: FloatArray | None = None
        self.named = dict(joints[self._index].settings)
        """The settings that the robot file names for the joint."""
        with self._buses(joints) as buses:
            self.joints = [_looked_at(buses[one.bus], one) for one in joints]
            self.gains = read_gains(buses[self.joint.bus], self.joint)
            """Those with which the joint is driven, by name."""
            self.held = [servo_name(one) for one in joints if drives(buses[one.bus], one.servo_id, one.model)]
            """The servos that held torque."""
            self.position = _position(buses[self.joint.bus], self.joint)
            """Where the joint stands, rad or m."""

    @property
    def joint(self) -> Joint:
        """The joint, with the settings that its servo has."""
        return self.joints[self._index]

    @contextmanager
    def _buses(self, joints: Sequence[Joint]) -> Iterator[Mapping[str, Bus]]:
        buses = self._open(joints)
        with ExitStack() as stack:
            for bus in buses.values():
                stack.enter_context(closing(bus))
            yield buses

    def releases(self, writes: bool) -> str:
        """State what becomes of the servos that hold torque, if they are released; empty if they are not.

        Args:
            writes: Whether gains are to be written, for which the arm is limp.
        """
        if not self.held or not (writes or self._ending.relax):
            return ""
        return f"Here {torque_warning(self.held)}, which this does."

    def check_write(self, wanted: bool) -> None:
        """Raise TuneError where gains could not be written later: the arm must be able to be limp somewhere."""
        if wanted and self.held and not self._ending.park:
            raise TuneError(
                "the arm is under torque, and its robot file has no park pose: gains are written to a limp arm, and "
                "nobody knows where it may be let go. Lay it down, switch its torque off, and run this again"
            )

    def measure(self, at: float | None, again: Callable[[Measurement], bool] = lambda found: False) -> Measurement:
        """Measure the joint, and leave the arm as it is to be left; limp where it is to be measured ``again``.

        ``at``: where, rad or m. Raises TuneError where the joint does not follow, StoppedError, DriverError, HalError.
        """
        arm = SlowArm(lambda: self._open(self.joints), self.joints, self._clock, self._stopped, FASTEST_RAD_S, PERIOD_S)
        arm.relax = self._ending.relax
        with arm:
            try:
                found = self._measured(arm, at)
            except (StoppedError, TuneError):
                self._end(arm)  # which ends at once where a servo has failed, and is still missing
                raise
            arm.relax = again(found) or self._ending.relax
            self._end(arm)
        return found

    def write(self, values: Mapping[str, int]) -> tuple[Written, ...]:
        """Write gains to the joint's servo, which is limp; what had to be changed. Raises ServoError, StoppedError."""
        if self._stopped():
            raise StoppedError("stopped: nothing was written")
        with self._buses(self.joints) as buses:
            done = write_gains(buses[self.joint.bus], self.joint, values)
        self.joints[self._index] = with_gains(self.joint, values)
        self.gains = {**self.gains, **values}
        return done

    def _end(self, arm: SlowArm) -> None:
        """Bring the joint back, or all to the park pose; a second signal skips that."""
        arm.stopped = self._hurry
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
        trial = Trial(arm, self._index, plan)
        half_way = trial.look_for_room()
        steps = [trial.step(target) for _ in range(TIMES) for target in (plan.far, plan.near)]
        sine = trial.sine()
        count = abs(self.joint.units_per_count)
        found = figures(steps, sine, plan.sine_hz, count, half_way)
        return Measurement(dict(self.gains), plan, found, tuple(steps), sine)


def _looked_at(bus: Bus, joint: Joint) -> Joint:
    """The joint with the settings of its servo, which is there and of the model that the robot file says."""
    try:
        bus.identify(joint.servo_id, joint.model)
        return as_held(bus, joint)
    except ServoError as error:
        raise TuneError(f"{joint.name}: {error}; `servoloop doctor` says more") from error


def _position(bus: Bus, joint: Joint) -> float:
    reading = bus.read_states([joint.servo_id])[joint.servo_id]
    if not isinstance(reading, ServoState):
        raise TuneError(f"{joint.name}: {reading.text}")
    return joint.position(reading.position_counts)
