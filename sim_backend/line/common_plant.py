"""Several servo buses on one plant. The buses share one world and one time.

Each bus advances the plant to its own time. The first bus that needs a step advances the whole plant: first the
firmware on all buses, then the mechanics. When the other buses need this step, it has already been done. Therefore, the
servos on a bus can be slightly ahead of the packet on that bus. The difference is at most the duration of a packet on
another bus, which is less than a millisecond.
"""

from collections.abc import Sequence
from typing import Any

from sim_backend.line.line import ServoLine
from sim_backend.line.rig import AnyServo, Rig
from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.plant import Plant


class PlantPart(Plant):
    """A subset of a plant's shafts. ``advance`` does nothing, because the plant advances only after all parts have set
    their torques."""

    def __init__(self, plant: Plant, places: Sequence[int]) -> None:
        couplings = [plant.couplings[i] for i in places]
        super().__init__(couplings, plant.timestep_s, plant.joints, plant.shafts[list(places)])
        self._plant, self._places = plant, tuple(places)

    def fit(self, gears: Sequence[Gears | None]) -> None:
        everywhere: list[Gears | None] = [None] * len(self._plant.couplings)
        for place, own in zip(self._places, gears, strict=True):
            everywhere[place] = own
        self._plant.fit(everywhere)

    def advance(self) -> None:
        pass


class CommonPlant:
    """A plant shared by several buses. Create a ``part`` for each bus, and then let the bus ``join`` the plant."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._rigs: list[_JoinedRig[Any]] = []
        self._steps = 0

    def part(self, joints: Sequence[str]) -> PlantPart:
        """Return the shafts of these joints, in the plant's order."""
        places = [i for i, coupling in enumerate(self._plant.couplings) if coupling.joint in joints]
        return PlantPart(self._plant, places)

    def join(self, line: ServoLine[Any]) -> None:
        """From now on, advance the servos on this bus together with those on all other buses.

        Call this method before the first time step of the bus.
        """
        line.rig = _JoinedRig(line.rig, self)
        self._rigs.append(line.rig)

    def reach(self, steps: int) -> None:
        """Advance the whole plant to this step, unless it has already been advanced."""
        while self._steps < steps:
            for rig in self._rigs:
                rig.step_servos()
            self._plant.advance()
            self._steps += 1


class _JoinedRig(Rig[AnyServo]):
    """The servos on one bus, with a count of the steps taken by the bus. The first bus that requests a step advances
    all buses."""

    def __init__(self, rig: Rig[AnyServo], common: CommonPlant) -> None:
        super().__init__(rig.servos, rig.plant, rig.supply)
        self._common = common
        self._asked = 0

    def step(self) -> None:
        self._asked += 1
        self._common.reach(self._asked)

    def step_servos(self) -> None:
        """Advance the servos on this bus by one step."""
        super().step()
