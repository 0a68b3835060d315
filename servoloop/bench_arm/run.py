"""The whole bench of an arm: its buses, its loop and motions, and the ROS surface where there is ROS.

measured = bench_arm(find_arm("so101"), {"": "/dev/ttyACM0"}, MonotonicClock())
print(measured.figures.loop.late, measured.figures.motions)
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drivers.clock import Clock
from drivers.port.serial_port import SerialPort
from nodes.ros_environment import RosError, require_ros
from servoloop.arms.folder import Arm, read_arm_files
from servoloop.arms.pick_place import load_pick_place
from servoloop.bench_arm.buses import measure_buses
from servoloop.bench_arm.figures import ArmFigures, JointMotion, machine_figures
from servoloop.bench_arm.ros_run import RosRun, run_ros
from servoloop.bench_arm.slow import bench_poses, slow
from servoloop.bench_arm.trial import Trial, run_trial
from servoloop.bench_bus import Run
from servoloop.demo.following_error import following_error
from servoloop.processes import Interrupted
from servoloop.realtime import claim_realtime_priority

if TYPE_CHECKING:
    from servoloop.simulation.virtual_lines import VirtualLines


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
