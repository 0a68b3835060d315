"""One loose servo on its own bus in simulated time, with a freely turning horn."""

from collections.abc import Callable
from math import inf, tau

from commissioning.drive_trial import TrialMotion
from commissioning.set_up.only_one import ServoPlace
from commissioning.set_up.turn import turn_loose
from drivers.bus.bus import Bus
from drivers.servos import sts
from drivers.servos.register import ServoModel
from sim_backend.buses.feetech import VirtualBus
from sim_backend.clock import SimulatedClock
from sim_backend.line.rig import Rig, Supply
from sim_backend.line.spread import Spread
from sim_backend.mechanics.motor import sts_motor
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.servo import VirtualServo
from tests.commissioning.box import Port


class Plant(BenchPlant):
    """A shaft that records its highest speed and its outermost angles, in rad. The shaft turns freely between its
    stops."""

    def __init__(self, angle_rad: float) -> None:
        super().__init__([1])
        self.place([angle_rad])
        self.fastest = 0.0
        self.ends = [angle_rad, angle_rad]
        self.stops = -inf, inf

    def advance(self) -> None:
        super().advance()
        self._stop()
        angle = float(self.joints.position[0])
        self.fastest = max(self.fastest, abs(float(self.joints.velocity[0])))
        self.ends = [min(self.ends[0], angle), max(self.ends[1], angle)]

    def _stop(self) -> None:
        angle = float(self.joints.position[0])
        if not self.stops[0] <= angle <= self.stops[1]:
            self.place([min(max(angle, self.stops[0]), self.stops[1])])


class Loose:
    """A loose servo; ``seed`` selects the production tolerances, and ``counts`` the position."""

    def __init__(
        self, model: ServoModel, seed: int | None = None, supply_v: float | None = None, counts: int = 2048
    ) -> None:
        spread = Spread(seed)
        self.model = model
        self.clock = SimulatedClock(10.0)
        self.servo = VirtualServo(model, 1, spread.motor(sts_motor(model), 1))
        self.plant = Plant((counts + 0.5) * tau / model.counts_per_turn)
        supply = spread.supply(Supply(supply_v or model.rated_voltage_v))
        self.line: VirtualBus = VirtualBus(Rig([self.servo], self.plant, supply))
        self.port = Port(self.line, self.clock)
        self.bus = Bus(self.port, self.clock)

    def turn(self, place: ServoModel | None = None, stopped: Callable[[], bool] = lambda: False) -> TrialMotion | None:
        """Run the gear test for a joint that needs this model."""
        return turn_loose(self.bus, self.clock, 1, ServoPlace("jaw", 1, place or self.model), stopped)

    @property
    def left(self) -> tuple[int, int]:
        """Torque enable and torque limit of the servo."""
        return self.servo.memory.get(sts.torque_enable), self.servo.memory.get(sts.torque_limit)


class Cut:
    """Call a function before the n-th packet."""

    def __init__(self, at: int, what: Callable[[], None]) -> None:
        self.left, self.what = at, what

    def __call__(self, data: bytes) -> None:
        self.left -= 1
        if self.left == 0:
            self.what()


def interrupt() -> None:
    raise KeyboardInterrupt
