"""The whole bench of an arm: its buses, its loop and motions, and the ROS surface where there is ROS.

measured = bench_arm(find_arm("so101"), {"": "/dev/ttyACM0"}, MonotonicClock())
print(measured.figures.loop.late, measured.figures.motions)
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from commissioning.provision import drives
from drivers.bus.bus import Bus
from drivers.bus.types import ServoGoal
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.port.serial_port import SerialPort
from drivers.servos.register import ServoModel
from hal.joint import Joint
from hal.servos.limp_arm import servo_name, torque_warning
from nodes.ros_environment import RosError, require_ros
from servoloop.bench.bus import Run, run_cycles, standing_still
from servoloop.bench.figures import ArmFigures, JointMotion, machine_figures
from servoloop.bench.motion import Trial, bench_poses, run_trial, slow
from servoloop.bench.ros import RosRun, run_ros
from servoloop.simulation.recording import following_error
from servoloop.stack.arm_folders import Arm, read_arm_files
from servoloop.stack.hardware import OpenPort, open_buses
from servoloop.stack.pick_place import load_pick_place
from servoloop.stack.processes import Interrupted, claim_realtime_priority, on_one_processor
from servoloop.stack.robot_files import Files

if TYPE_CHECKING:
    from servoloop.stack.virtual_lines import VirtualLines


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
            f"{torque_warning(held)}. This command releases the arm at its end: lay the arm down, and switch its "
            "torque off first"
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


@dataclass(frozen=True, slots=True)
class Measured:
    """The figures, and what they were made of: for the pictures."""

    figures: ArmFigures
    buses: Mapping[str, Run]
    trial: Trial
    ros: RosRun | None


def bench_arm(
    arm: Arm,
    devices: Mapping[str, str],
    clock: Clock,
    *,
    signals: Callable[[], int] = lambda: 0,
    say: Callable[[str], None] = lambda text: None,
    virtual: "VirtualLines | None" = None,
) -> Measured:
    """Measure a limp arm on these devices, by bus: it moves to its ready pose, each joint a little, and back, slowly.

    It is limp behind it, where it lay, whatever happens. ``signals``: how many there were; one ends it, a second one
    skips the way back. ``virtual``: lines in this process instead of devices.

    Raises DriverError, HalError, Interrupted.
    """
    files = slow(read_arm_files(arm))
    poses = bench_poses(load_pick_place(arm.pick_place), files.limits)
    say("the buses, as fast as they go")
    buses = measure_buses(files, devices, clock, virtual.open if virtual else SerialPort)
    if signals():
        raise Interrupted("interrupted: nothing was moved")
    realtime = claim_realtime_priority() if virtual is None else False
    say("the loop and the motions: ready pose, each joint a little, and back")
    trial = run_trial(files, poses, devices, clock, signals, virtual)
    ros, without_ros = None, _no_ros() if virtual is None else "virtual lines in this process"
    if not without_ros:
        say("the same stack under ROS, and a client of it")
        ros = run_ros(arm, files, poses[0], trial.lay, devices, signals)
    say("the arm is where it lay, and its torque is off")
    figures = ArmFigures(
        arm.name,
        dict(devices),
        machine_figures(devices.values(), realtime),
        {name: run.figures for name, run in buses.items()},
        trial.timing,
        _motions(trial),
        ros.figures if ros else None,
        without_ros,
    )
    return Measured(figures, buses, trial, ros)


def _no_ros() -> str:
    """Why there is no ROS here; empty where there is."""
    try:
        require_ros()
    except RosError as error:
        return str(error)
    return ""


def _motions(trial: Trial) -> tuple[JointMotion, ...]:
    error = np.array(trial.reference) - np.array(trial.position)
    found = following_error(np.array(trial.time_s), error, np.array(trial.velocity))
    rows = zip(trial.joints, found.largest_rad, found.rms_moving_rad, found.at_rest_rad, strict=True)
    return tuple(JointMotion(*row) for row in rows)
