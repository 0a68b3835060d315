"""Several lines of servos on one plant. The lines share one world and one time.

Each line advances the plant to the line's own time. The first line that needs a step advances the whole plant: first
the firmware of all lines, then the mechanics. When the other lines need this step, it is already done. The servos of a
line can therefore be slightly ahead of the line's own packet. The difference is at most the time of another line's
packet on the wire, which is less than a millisecond.
"""

from collections.abc import Sequence
from typing import Any

from sim_backend.line.line import ServoLine
from sim_backend.line.rig import AnyServo, Rig
from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.plant import Plant


class PlantPart(Plant):
    """Part of a plant's shafts. ``advance`` does nothing; the plant moves after all parts have set their torques."""

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
    """A plant that several lines share. Create a ``part`` for each line, and then let the line ``join`` the plant."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._rigs: list[_JoinedRig[Any]] = []
        self._steps = 0

    def part(self, joints: Sequence[str]) -> PlantPart:
        """Return the shafts of these joints, in the plant's order."""
        places = [i for i, coupling in enumerate(self._plant.couplings) if coupling.joint in joints]
        return PlantPart(self._plant, places)

    def join(self, line: ServoLine[Any]) -> None:
        """From now on, advance the line's servos together with those of all other lines.

        Call this method before the line's time begins.
        """
        line.rig = _JoinedRig(line.rig, self)
        self._rigs.append(line.rig)

    def reach(self, steps: int) -> None:
        """Advance the whole plant to this step, unless this has already been done."""
        while self._steps < steps:
            for rig in self._rigs:
                rig.step_servos()
            self._plant.advance()
            self._steps += 1


class _JoinedRig(Rig[AnyServo]):
    """The servos of one line, with a count of the line's steps. The first line that requests a step advances all
    lines."""

    def __init__(self, rig: Rig[AnyServo], common: CommonPlant) -> None:
        super().__init__(rig.servos, rig.plant, rig.supply)
        self._common = common
        self._asked = 0

    def step(self) -> None:
        self._asked += 1
        self._common.reach(self._asked)

    def step_servos(self) -> None:
        """Advance this line's servos by one step."""
        super().step()
