"""Typical problems of arms, each applied to a virtual arm (``Patient``)."""

from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np

from drivers.driver_errors import PortBusy, PortDenied, PortLost
from drivers.servos import sts
from hal.robot_file.calibration_file import CalibrationFile
from sim_backend.buses.feetech import VirtualBus, servo_of
from sim_backend.buses.port import VirtualPort
from sim_backend.faults import Disturbance
from sim_backend.line.power import feed, restart
from sim_backend.line.rig import Rig, Supply
from sim_backend.packets.sts import Code
from tests.commissioning.patient import Patient

ELBOW = 3
LAST = 7


def unpowered(patient: Patient) -> None:
    feed(patient.line, 0.0)


def unplugged_servo(patient: Patient) -> None:
    patient.line.faults.silence(ELBOW)


def broken_chain(patient: Patient) -> None:
    for servo_id in range(5, LAST + 1):
        patient.line.faults.silence(servo_id)


def lossy_line(patient: Patient) -> None:
    patient.line.faults.disturbance = Disturbance(1, drop=0.03)


def noisy_line(patient: Patient) -> None:
    patient.line.faults.disturbance = Disturbance(1, flip=0.02, noise=0.02)


def other_rate(patient: Patient) -> None:
    patient.put(ELBOW, sts.baud_rate, sts.BAUD_RATES.index(115_200))


def all_at_another_rate(patient: Patient) -> None:
    for servo in patient.line.servos:
        patient.put(servo.servo_id, sts.baud_rate, sts.BAUD_RATES.index(500_000))


def same_id(patient: Patient) -> None:
    patient.plant.joints.position[patient.plant.joints.position_at[ELBOW - 1]] = 0.7
    patient.wait(0.1)
    patient.put(ELBOW, sts.servo_id, 2)


def factory_id(patient: Patient) -> None:
    """Servo 1 keeps its ID; servo 7 has a wrong ID."""
    patient.put(LAST, sts.servo_id, 11)


def stranger(patient: Patient) -> None:
    """Add an eighth servo whose shaft is not connected to the arm."""
    couplings = [*patient.plant.couplings, replace(patient.plant.couplings[0], servo_id=12)]
    plant = patient.plant
    shafts = np.concatenate([plant.shafts, plant.shafts[:1]])
    plant.couplings, plant.shafts, plant._rows = tuple(couplings), shafts, shafts.tolist()
    servos = [servo_of(sts.STS3215, coupling.servo_id) for coupling in couplings]
    patient.lines[""] = patient.line = VirtualBus(Rig(servos, plant, Supply(12.0)))


def other_model(patient: Patient) -> None:
    patient.put(ELBOW, sts.model_number, sts.STS3250.number)


def mute(patient: Patient) -> None:
    """Make the servo answer only pings."""
    servo: Any = patient.line.servo(ELBOW)
    answer = servo.answer
    servo.answer = lambda instruction: answer(instruction) if instruction.code == Code.PING else None
    servo.GROUP_READ = None


def loose_plug(patient: Patient) -> None:
    """Make one servo answer only some requests."""
    questions = count()
    patient.line.faults.on_instruction.append(lambda servo_id: servo_id != ELBOW or next(questions) % 3 == 0)


def wheel_mode(patient: Patient) -> None:
    patient.put(ELBOW, sts.operating_mode, 1)


def odd_phase(patient: Patient) -> None:
    patient.put(ELBOW, sts.phase, 8)


def narrow_limits(patient: Patient) -> None:
    patient.put(ELBOW, sts.min_position, 1500)
    patient.put(ELBOW, sts.max_position, 2500)


def foreign_offset(patient: Patient) -> None:
    """Give the arm the homing offsets of another program."""
    _calibrated_with(patient, {ELBOW: 120})


def exchanged_ids(patient: Patient) -> None:
    """Exchange the IDs of two servos after a calibration with different offsets."""
    _calibrated_with(patient, {2: -300, ELBOW: 120})
    patient.put(2, sts.homing_offset, 120)
    patient.put(ELBOW, sts.homing_offset, -300)


def _calibrated_with(patient: Patient, offsets: dict[int, int]) -> None:
    joints = [replace(joint, homing_offset=offsets.get(joint.servo_id, 0)) for joint in patient.robot.joints]
    patient.robot = replace(patient.robot, joints=tuple(joints))


def open_lock(patient: Patient) -> None:
    patient.put(ELBOW, sts.lock, 0)


def no_acknowledgement(patient: Patient) -> None:
    patient.put(ELBOW, sts.status_level, 0)


def lerobots_gains(patient: Patient) -> None:
    patient.put(ELBOW, sts.position_p, 16)


def no_gain(patient: Patient) -> None:
    patient.put(ELBOW, sts.position_p, 0)


def wide_dead_zone(patient: Patient) -> None:
    patient.put(ELBOW, sts.cw_dead_zone, 20)


def slow_start(patient: Patient) -> None:
    patient.put(ELBOW, sts.max_acceleration, 5)


def other_settings(patient: Patient) -> None:
    """Overwrite settings of the robot file, as another program would."""
    joints = [replace(joint, settings=(("position_d", 40),)) for joint in patient.robot.joints]
    patient.robot = replace(patient.robot, joints=tuple(joints))


def no_protection(patient: Patient) -> None:
    patient.put(LAST, sts.unloading_condition, 0)
    patient.put(LAST, sts.protection_current, 0)


def no_torque_allowed(patient: Patient) -> None:
    patient.put(ELBOW, sts.max_torque, 0)


def long_delay(patient: Patient) -> None:
    patient.put(ELBOW, sts.return_delay, 250)


def old_firmware(patient: Patient) -> None:
    patient.put(ELBOW, sts.firmware_minor, 9)


def twelve_volts_too_many(patient: Patient) -> None:
    feed(patient.line, 2.0 * patient.robot.joints[0].model.rated_voltage_v)
    patient.wait(0.2)


def usb_alone(patient: Patient) -> None:
    feed(patient.line, 5.0)
    patient.wait(0.2)


def lively_supply(patient: Patient) -> None:
    feed(patient.line, 14.2)
    for servo in patient.line.servos:
        patient.put(servo.servo_id, sts.max_voltage, 160)
    patient.wait(0.2)


def wrong_voltage_limit(patient: Patient) -> None:
    """Set the voltage limit of a 7.4 V servo in a 12 V servo."""
    patient.put(ELBOW, sts.max_voltage, 80)
    patient.wait(0.2)


def thin_lead(patient: Patient) -> None:
    """Reduce the voltage that one servo measures."""
    servo: Any = patient.line.servo(ELBOW)
    read = servo.read

    def low(address: int, size: int) -> bytes:
        data = bytearray(read(address, size))
        at = sts.present_voltage.address - address
        if 0 <= at < len(data):
            data[at] -= 12
        return bytes(data)

    servo.read = low


def sagging_supply(patient: Patient) -> None:
    """Make the supply fail and return repeatedly, like an overloaded supply or an empty battery."""
    plant: Any = patient.line.rig.plant
    plant._after_step = lambda time_s: patient.line.rig.feed(10.0 if time_s % 0.1 < 0.05 else 12.0)


def overload(patient: Patient) -> None:
    """Close the jaw on an object until the overload protection acts."""
    stall(patient, 900, protection_current=511)
    patient.wait(3.5)


def over_current(patient: Patient) -> None:
    """Close the jaw on an object until the overcurrent protection releases the torque."""
    stall(patient, 900)
    patient.wait(3.5)


def stall(patient: Patient, torque: int, protection_current: int = 310) -> None:
    """Block the hand and command its servo to a goal far beyond the obstacle, with the factory protections."""
    patient.hold()
    protections = {sts.max_torque: 1000, sts.overload_torque: 80, sts.protection_current: protection_current}
    for register, value in protections.items():
        patient.put(LAST, register, value)
    bus, finger = patient.bus(), patient.robot.joints[-1]
    block(patient, LAST)
    bus.write(LAST, sts.torque_limit, torque)
    bus.write(LAST, sts.goal_position, finger.counts(finger.limits.upper))
    patient.wait(0.6)


def block(patient: Patient, servo_id: int) -> None:
    """Block a joint at its present position."""
    plant = patient.plant
    at, speed = plant.joints.position_at[servo_id - 1], plant.joints.velocity_at[servo_id - 1]
    here, before = float(plant.joints.position[at]), plant._after_step

    def stay(time_s: float) -> None:
        plant.joints.position[at], plant.joints.velocity[speed] = here, 0.0
        if before is not None:
            before(time_s)

    plant._after_step = stay


def pressing_gripper(patient: Patient) -> None:
    stall(patient, 400)


def heat(patient: Patient) -> None:
    servo: Any = patient.line.servo(ELBOW)
    servo.firmware.temperature_c = 90.0
    patient.wait(0.2)


def warmth(patient: Patient) -> None:
    servo: Any = patient.line.servo(ELBOW)
    servo.firmware.temperature_c = 67.0
    patient.wait(0.2)


def limp_joint(patient: Patient) -> None:
    """Reset one servo, as a power dip does, while the arm holds its position."""
    patient.hold()
    restart(patient.line.servo(ELBOW))
    patient.wait(1.5)


def reset_and_driven(patient: Patient) -> None:
    """Reset one servo while the arm holds its position, and then send the servo a goal that enables its torque
    again."""
    limp_joint(patient)
    bus = patient.bus()
    bus.write(ELBOW, sts.goal_position, bus.read(ELBOW, sts.present_position))
    patient.wait(0.5)


def damped(patient: Patient) -> None:
    patient.put(ELBOW, sts.torque_enable, 2)


def far_outside(patient: Patient) -> None:
    """Shift the zero of a joint, as if its horn was mounted wrongly."""
    joints = [
        replace(joint, zero_counts=joint.zero_counts - 2000) if joint.servo_id == ELBOW else joint
        for joint in patient.robot.joints
    ]
    patient.robot = replace(patient.robot, joints=tuple(joints))


def full_turn(patient: Patient) -> None:
    """Store a whole turn as the range of a wrist that has stops."""
    _calibration(patient, lower_counts=0, upper_counts=4095)


def missed_stop(patient: Patient) -> None:
    _calibration(patient, lower_counts=1300)


def wrong_pose(patient: Patient) -> None:
    """Store a zero that is wrong by ten degrees."""
    assert patient.calibration is not None
    zero = patient.calibration.joints[patient.robot.joints[ELBOW - 1].name].zero_counts
    _calibration(patient, zero_counts=zero + 114)


def over_the_seam(patient: Patient) -> None:
    _calibration(patient, lower_counts=-400, upper_counts=2300)


def _calibration(patient: Patient, **changed: int) -> None:
    assert patient.calibration is not None
    joints = dict(patient.calibration.joints)
    name = patient.robot.joints[ELBOW - 1].name
    joints[name] = joints[name].model_copy(update=changed)
    patient.calibration = CalibrationFile(joints=joints)


def nobody_calibrated(patient: Patient) -> None:
    patient.calibration = None


def denied(patient: Patient) -> None:
    patient.open_error = PortDenied("no permission to open /dev/ttyACM0: it belongs to the group 'dialout'")


def busy(patient: Patient) -> None:
    patient.open_error = PortBusy("/dev/ttyACM0 is in use by python3 (process 812): end that program first")


def pulled_plug(patient: Patient) -> None:
    """Unplug the adapter during the examination."""

    class Pulled(VirtualPort):
        written = 0

        def write(self, data: bytes) -> None:
            Pulled.written += 1
            if Pulled.written > 40:
                raise PortLost("/dev/ttyACM0 is gone: check the cable and the servos' power, then start again")
            super().write(data)

    patient.port = Pulled


def slow_adapter(patient: Patient) -> None:
    """A port whose adapter buffers received bytes for 16 ms."""

    class Slow(VirtualPort):
        def read(self, size: int, deadline_s: float) -> bytes:
            now_s = patient.clock.now()
            patient.clock.sleep_until(0.016 * (int(now_s / 0.016) + 1))
            return super().read(size, max(deadline_s, patient.clock.now()))

    patient.port = Slow


def hub(patient: Patient) -> None:
    """A port that delays every reply until the next request."""

    class Held(VirtualPort):
        held = b""

        def write(self, data: bytes) -> None:
            self._arrived += self.held
            self.held = b""
            super().write(data)

        def read(self, size: int, deadline_s: float) -> bytes:
            late, self._arrived[:] = bytes(self._arrived), b""
            self.held += super().read(64, max(deadline_s, patient.clock.now() + 0.003))
            return late[:size]

    patient.port = Held


def echoing_adapter(patient: Patient) -> None:
    """A port that echoes every request before the reply."""

    class Echoing(VirtualPort):
        def write(self, data: bytes) -> None:
            self._arrived += data
            super().write(data)

    patient.port = Echoing
