"""Filter that removes implausible positions from the measurements of one component."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from hal.leaps import Plausibility
from hal.types import JointFault, JointLimits, JointState

LOG = logging.getLogger("servoloop.hal")

ARRAYS: Final = ("position", "velocity", "effort")


class LeapFilter:
    """Filter for position readings that jump.

    A joint that jumped is treated as not measured until a second reading agrees.
    """

    def __init__(self, component: str, joints: Sequence[str], limits: Mapping[str, JointLimits]) -> None:
        """Create the filter.

        Args:
            component: Name of the component, used in messages.
            joints: Names of its joints.
            limits: Joint limits, keyed by joint name. A joint without limits is not filtered.
        """
        self._component = component
        self._limits = {index: (name, limits[name]) for index, name in enumerate(joints) if name in limits}
        self.forget()

    def forget(self) -> None:
        """Discard all earlier readings. The next reading is always accepted."""
        self._plausibility = {index: Plausibility.of_limits(limits) for index, (_, limits) in self._limits.items()}
        self._last: JointState | None = None

    def believed(self, state: JointState, driven: bool) -> JointState:
        """Return the state. Joints that jumped keep their last known values and get a fault.

        Args:
            state: The measurement of one cycle.
            driven: Whether the component is active. A limp joint can be moved faster by hand than by its servo.
        """
        leaps = {}
        for index, (name, _) in self._limits.items():
            position = float(state.position[index])
            old = name in state.faults and state.faults[name].kind != "no_torque"
            if not old and (leap := self._plausibility[index].leap(position, state.stamp_s, driven)) is not None:
                leaps[index] = self._fault(name, position, leap)
        if leaps and self._last is not None:
            state = self._without(state, self._last, leaps)
        self._last = state
        return state

    def _without(self, state: JointState, last: JointState, leaps: Mapping[int, JointFault]) -> JointState:
        index = list(leaps)
        arrays = {name: getattr(state, name).copy() for name in ARRAYS}
        for name, array in arrays.items():
            array[index] = getattr(last, name)[index]
        named = {self._limits[i][0]: fault for i, fault in leaps.items()}
        for name in named.keys() - last.faults.keys():
            LOG.warning("%s: %s", self._component, named[name].text)
        return replace(state, **arrays, faults={**state.faults, **named})

    @staticmethod
    def _fault(name: str, position: float, leap: float) -> JointFault:
        return JointFault(
            "implausible",
            f"{name} is measured at {position:.4f}, {leap:+.4f} from the previous reading. No joint moves that fast, "
            "so the position is ignored until a second reading confirms it",
        )
