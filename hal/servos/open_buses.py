"""Open the buses of one component."""

from collections.abc import Callable, Mapping, Sequence

from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError
from hal.joint import Joint
from hal.servos.joint_buses import JointBuses

OpenBuses = Callable[[], Bus | Mapping[str, Bus]] | Mapping[str, Callable[[], Bus]]
"""Function that opens the only bus or all buses of a component, or a function for each bus, keyed by name."""


def open_all(joints: Sequence[Joint], open_buses: OpenBuses) -> JointBuses:
    """Open all buses. Raises the first DriverError, with all buses closed."""
    buses, errors = open_reachable(joints, open_buses)
    if errors:
        buses.close()
        raise errors[0]
    return buses


def open_reachable(joints: Sequence[Joint], open_buses: OpenBuses) -> tuple[JointBuses, list[DriverError]]:
    """Open the buses that can be opened. Return these buses, and the errors of the others.

    Raises DriverError if no bus can be opened, or if one function opens all buses and fails.
    """
    if not isinstance(open_buses, Mapping):
        opened = open_buses()
        return JointBuses(joints, opened if isinstance(opened, Mapping) else {joints[0].bus: opened}), []
    buses: dict[str, Bus] = {}
    errors: list[DriverError] = []
    try:
        for name, open_bus in open_buses.items():
            try:
                buses[name] = open_bus()
            except DriverError as error:
                errors.append(error)
    except BaseException:
        JointBuses(joints, buses).close()
        raise
    if not buses:
        raise errors[0]
    return JointBuses(joints, buses), errors
