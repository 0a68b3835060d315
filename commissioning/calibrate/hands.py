"""What hands did to all joints while one of them was asked for."""

from math import tau

from commissioning.calibrate.sweep import Sweep
from hal.joint import Joint


class Hands:
    """The continuous counts of all joints during one task, from one look to the next."""

    def __init__(self, sweep: Sweep) -> None:
        self._sweep = sweep
        self._counts: dict[str, list[int]] = {joint.name: [] for joint in sweep.joints}

    def look(self) -> None:
        """Note where all joints are; a servo that has never answered is left out."""
        for name, swept in self._sweep.swept.items():
            self._counts[name].append(swept.counts)

    def counts(self, joint: Joint) -> list[int]:
        """The counts of one joint. Raises CalibrationError where its servo has never answered."""
        self._sweep.of(joint)
        return self._counts[joint.name]

    def moved_instead(self, joint: Joint, shown_rad: float) -> Joint | None:
        """The other joint whose servo turned the most while this one's did not; None where none did."""
        turned = {one.name: self._turned_rad(one) for one in self._sweep.joints}
        if turned[joint.name] >= shown_rad:
            return None
        most = max(self._sweep.joints, key=lambda one: turned[one.name])
        return most if turned[most.name] >= shown_rad else None

    def _turned_rad(self, joint: Joint) -> float:
        counts = self._counts[joint.name]
        return (max(counts) - min(counts)) * tau / joint.model.counts_per_turn if counts else 0.0
