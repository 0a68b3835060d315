"""Record the motion of all joints while the user is asked to move one of them."""

from math import tau

from commissioning.calibrate.sweep import Sweep
from hal.joint import Joint


class Hands:
    """Continuous counts of all joints during one task of the user."""

    def __init__(self, sweep: Sweep) -> None:
        self._sweep = sweep
        self._counts: dict[str, list[int]] = {joint.name: [] for joint in sweep.joints}

    def update(self) -> None:
        """Add the current counts of every joint whose servo has replied."""
        for name, swept in self._sweep.swept.items():
            self._counts[name].append(swept.counts)

    def counts(self, joint: Joint) -> list[int]:
        """Return the counts of one joint. Raises CalibrationError if the joint's servo has never replied."""
        self._sweep.of(joint)
        return self._counts[joint.name]

    def moved_instead(self, joint: Joint, shown_rad: float) -> Joint | None:
        """Return the other joint that turned the most while this joint did not turn; None if no joint turned."""
        turned = {one.name: self._turned_rad(one) for one in self._sweep.joints}
        if turned[joint.name] >= shown_rad:
            return None
        most = max(self._sweep.joints, key=lambda one: turned[one.name])
        return most if turned[most.name] >= shown_rad else None

    def _turned_rad(self, joint: Joint) -> float:
        counts = self._counts[joint.name]
        return (max(counts) - min(counts)) * tau / joint.model.counts_per_turn if counts else 0.0
