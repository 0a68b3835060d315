"""Several lines of servos over one plant: one world, one time, however many wires lead into it.

Each line asks for physics up to its own moment. Whichever asks first moves everything: the firmware of all
lines, and then the plant, once. The others find the step done. So a line can find its servos ahead of its own
packet by as much as the other line has looked ahead: one packet's time on the wire, under a millisecond.
"""

from collections.abc import Sequence
from typing import Any

from sim_backend.line.line import ServoLine
from sim_backend.line.rig import AnyServo, Rig
from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.plant import Plant


class PlantPart(Plant):
    """Some of a plant's shafts. ``advance`` does nothing: the plant moves when all parts have had their torques."""

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
    """The plant below several lines: give each line a ``part``, and let it ``join``."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._rigs: list[_JoinedRig[Any]] = []
        self._steps = 0

    def part(self, joints: Sequence[str]) -> PlantPart:
        """The shafts of these joints, in the plant's order."""
        places = [i for i, coupling in enumerate(self._plant.couplings) if coupling.joint in joints]
        return PlantPart(self._plant, places)

    def join(self, line: ServoLine[Any]) -> None:
        """From now on the line's servos move with those of all lines. Before the line's time begins."""
        line.rig = _JoinedRig(line.rig, self)
        self._rigs.append(line.rig)

    def reach(self, steps: int) -> None:
        """Bring everything to this step, unless it is there."""
        while self._steps < steps:
            for rig in self._rigs:
                rig.step_servos()
            self._plant.advance()
            self._steps += 1


class _JoinedRig(Rig[AnyServo]):
    """One line's servos. Their line counts its steps here; who is first moves all."""

    def __init__(self, rig: Rig[AnyServo], common: CommonPlant) -> None:
        super().__init__(rig.servos, rig.plant, rig.supply)
        self._common = common
        self._asked = 0

    def step(self) -> None:
        self._asked += 1
        self._common.reach(self._asked)

    def step_servos(self) -> None:
        """This line's share of one step."""
        super().step()
