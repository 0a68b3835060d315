"""The buses of an arm, measured as ``servoloop bench bus`` does: every servo is held where it stands, and let go."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from typing import Final

from commissioning.provision import drives
from drivers.bus.bus import Bus
from drivers.bus.types import ServoGoal
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.servos.register import ServoModel
from hal.joint import Joint
from hal.servos.limp_arm import servo_name, torque_warning
from servoloop.bench_bus import Run, run_cycles, standing_still
from servoloop.files import Files
from servoloop.hardware import OpenPort, open_buses
from servoloop.realtime import on_one_processor

CYCLES: Final = 1000


def measure_buses(
    files: Files, devices: Mapping[str, str], clock: Clock, open_port: OpenPort, cycles: int = CYCLES
) -> dict[str, Run]:
    """One run for each bus, by its name. Raises DriverError where a servo is missing, another, or under torque.

    All are looked at before the first gets torque.
    """
    file = files.robot.file
    on_bus = {name: [joint for joint in files.robot.joints if joint.bus == name] for name in file.lines()}
    buses = open_buses(file, devices, clock, open_port=open_port)
    with ExitStack() as opened:
        for bus in buses.values():
            opened.enter_context(closing(bus))
        for name, bus in buses.items():
            _require_limp(bus, on_bus[name])
        return {name: _run(bus, on_bus[name], clock, cycles) for name, bus in buses.items()}


def _require_limp(bus: Bus, joints: Sequence[Joint]) -> None:
    for joint in joints:
        bus.identify(joint.servo_id, joint.model)
    if held := [servo_name(joint) for joint in joints if drives(bus, joint.servo_id, joint.model)]:
        raise DriverError(
            f"{torque_warning(held)}. At its end this command releases the arm where it is now: lay the arm down and "
            "switch its torque off first"
        )


def _run(bus: Bus, joints: Sequence[Joint], clock: Clock, cycles: int) -> Run:
    by_model: dict[ServoModel, list[int]] = {}
    for joint in joints:
        by_model.setdefault(joint.model, []).append(joint.servo_id)
    goals: dict[int, ServoGoal] = {}
    with ExitStack() as held, on_one_processor():
        for model, servo_ids in by_model.items():
            goals |= held.enter_context(standing_still(bus, servo_ids, model, hold=True))
        return run_cycles(bus, clock, [joint.servo_id for joint in joints], goals, cycles)
