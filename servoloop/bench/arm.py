"""Measure an arm: its buses, its control loop and motions, and its ROS interface if ROS is installed.

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
from drivers.clock import Clock
from drivers.driver_errors import DriverError
from drivers.port.serial_port import SerialPort
from drivers.servos.register import ServoModel
from drivers.types import ServoGoal
from hal.joint import Joint
from hal.servos.limp_arm import servo_name, torque_warning
from nodes.ros_environment import RosError, require_ros
from servoloop.bench.bus import BusRun, run_cycles, standing_still
from servoloop.bench.figures import ArmFigures, JointMotion, machine_figures
from servoloop.bench.motion import BenchTrial, bench_poses, run_trial, slow
from servoloop.bench.ros import RosRun, run_ros
from servoloop.recording.following_error import following_error
from servoloop.stack.arm_folders import ArmFolder, read_arm_files
from servoloop.stack.hardware import OpenPort, open_buses
from servoloop.stack.pick_place import arm_jobs
from servoloop.stack.processes import Interrupted, claim_realtime_priority, on_one_processor
from servoloop.stack.robot_files import Files

if TYPE_CHECKING:
    from servoloop.stack.virtual_lines import VirtualLines


CYCLES: Final = 1000
"""Number of cycles to measure on each bus."""


def measure_buses(
    files: Files, devices: Mapping[str, str], clock: Clock, open_port: OpenPort, cycles: int = CYCLES
) -> dict[str, BusRun]:
    """Measure each bus and return the results, keyed by bus name.

    All servos are checked before the first servo is sent a goal. Raises DriverError if a servo is missing, is a
    different model or has its torque enabled.
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
            f"{torque_warning(held)}. At the end, this command disables the torque with the arm in its current "
            "pose. Lay the arm down and disable its torque first"
        )


def _run(bus: Bus, joints: Sequence[Joint], clock: Clock, cycles: int) -> BusRun:
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
    """Results of an arm, with the measurements for the plots."""

    figures: ArmFigures
    buses: Mapping[str, BusRun]
    trial: BenchTrial
    ros: RosRun | None


def bench_arm(
    arm: ArmFolder,
    devices: Mapping[str, str],
    clock: Clock,
    *,
    signals: Callable[[], int] = lambda: 0,
    say: Callable[[str], None] = lambda text: None,
    virtual: "VirtualLines | None" = None,
) -> Measured:
    """Measure an arm whose torque is off.

    The arm moves slowly to its ready pose, moves its joints one by one, and returns. At the end, the arm is back in its
    initial pose with its torque off, even after an error. If a robot has several arms, all of them move, but only the
    first arm is measured through ROS.

    Args:
        arm: The arm.
        devices: Serial device of each bus, keyed by bus name.
        clock: Clock for the measurements.
        signals: Function that returns the number of signals received. The first signal ends the measurement; a second
            signal skips the return motion.
        say: Function that prints a line of progress.
        virtual: Virtual buses in this process, used instead of the devices.

    Raises:
        DriverError: A servo or the arm does not behave as expected.
        HalError: A file of the arm is invalid.
        Interrupted: A signal was received.
    """
    files = slow(read_arm_files(arm))
    jobs = list(arm_jobs(arm.pick_place).values())
    poses = bench_poses(jobs, files.limits)
    say("measuring the buses")
    buses = measure_buses(files, devices, clock, virtual.open if virtual else SerialPort)
    if signals():
        raise Interrupted("interrupted; the arm was not moved")
    realtime = claim_realtime_priority() if virtual is None else False
    say("measuring the control loop and the motions: to the ready pose, each joint slightly, and back")
    trial = run_trial(files, poses, devices, clock, signals, virtual)
    ros, without_ros = None, _no_ros() if virtual is None else "the virtual servos run in this process"
    if not without_ros:
        say("measuring the same stack with ROS")
        ready = {joint: poses[0][joint] for joint in jobs[0].joints}
        ros = run_ros(arm, files, ready, trial.lay, devices, signals)
    say("the arm is in its initial pose, and its torque is off")
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
    """Return the reason why ROS is not available, or an empty string if ROS is available."""
    try:
        require_ros()
    except RosError as error:
        return str(error)
    return ""


def _motions(trial: BenchTrial) -> tuple[JointMotion, ...]:
    error = np.array(trial.reference) - np.array(trial.position)
    found = following_error(np.array(trial.time_s), error, np.array(trial.velocity))
    rows = zip(trial.joints, found.largest_rad, found.rms_moving_rad, found.at_rest_rad, strict=True)
    return tuple(JointMotion(*row) for row in rows)
