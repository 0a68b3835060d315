"""Set up servos: identify and check them, write their settings, measure positions, and enable or disable torque."""

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS, retry
from drivers.clock import Clock
from drivers.driver_errors import DriverError, PortError, ServoError, ServoRefused, ServoSilent
from drivers.eeprom import EepromError
from drivers.servos import sts
from drivers.servos.catalog import series_of
from drivers.servos.voltage import voltage_fault
from drivers.types import Reading, ServoFault, ServoState
from hal.joint import Joint
from hal.servos.diagnose import NO_BAUD_RATE, diagnose, intermittent_text, read_explained_states
from hal.servos.fault_log import FaultLog
from hal.servos.joint_buses import JointBuses
from hal.servos.open_buses import OpenBuses
from hal.servos.restart_turned import has_turned, restart
from hal.servos.servo_faults import REBOOT
from hal.servos.servo_gains import write_gains_in_ram
from hal.servos.servo_settings import (
    apply_settings,
    check_goal_current,
    check_homing_offset,
    check_mode,
    check_reach,
    warn_of_extended_position,
    warn_of_goal_current,
    warn_of_other_gains,
)

Result = TypeVar("Result")


class ServoSetup:
    """Slow access to single servos. It must not be used in a control cycle."""

    def __init__(self, buses: JointBuses) -> None:
        self._buses = buses

    def check(self) -> None:
        """Check that every servo responds and matches the robot file, and write the settings in the file.

        Raises:
            DriverError: A check failed, or settings could not be written. The message lists all errors.
        """
        if problems := self.identify_all():
            raise DriverError("\n".join(problems))
        self.settle()

    def settle(self) -> None:
        """Write the settings in the robot file to identified servos. Raises one DriverError that lists all errors."""
        if problems := self._settle_all():
            raise DriverError("\n".join(problems))
        for name, bus in self._buses.buses.items():
            with self._buses.named(name):
                for warn in (warn_of_extended_position, warn_of_goal_current, warn_of_other_gains):
                    _failed(self._buses.joints_on[name], bus, warn)  # errors are ignored for these warnings

    def problems(self) -> list[str]:
        """Check every servo and write the settings in the robot file. Return the errors."""
        return self.identify_all() or self._settle_all()

    def _settle_all(self) -> list[str]:
        return [problem for name, bus in self._buses.buses.items() for problem in self._settle_bus(name, bus)]

    def identify_all(self) -> list[str]:
        """Check that every servo responds and is the model specified for its joint. Nothing is written. Return the
        errors."""
        return [problem for name, bus in self._buses.buses.items() for problem in self._identify_bus(name, bus)]

    def _settle_bus(self, name: str, bus: Bus) -> list[str]:
        joints = self._buses.joints_on[name]
        with self._buses.named(name):
            errors = _failed(joints, bus, _settle)
        explained = (EepromError, ServoRefused)
        texts = {i: str(e) if isinstance(e, explained) else intermittent_text(i, bus.name) for i, e in errors.items()}
        # The notes of an error list the settings that were written before it.
        problems = {i: "; ".join([text, *getattr(errors[i], "__notes__", ())]) for i, text in texts.items()}
        return [f"{self._buses.label(j)}: {problems[j.servo_id]}" for j in joints if j.servo_id in problems]

    def _identify_bus(self, name: str, bus: Bus) -> list[str]:
        joints = self._buses.joints_on[name]
        with self._buses.named(name):
            errors = _failed(joints, bus, _identify)
            silent = [i for i, error in errors.items() if not isinstance(error, ServoRefused)]
            causes = diagnose(bus, silent) if silent else {}
            # Two servos with the same model and ID return the same model number. Only reading their states shows that
            # there are two servos.
            known = [joint.servo_id for joint in joints if joint.servo_id not in errors]
            found, stateless = read_explained_states(bus, known)
            causes |= stateless | _wrong_voltages(joints, bus, found)
        if len(causes) == len(joints) and all(NO_BAUD_RATE in text for text in causes.values()):
            which = f" (bus {name})" if self._buses.several else ""
            return [f"no servo responds on {bus.name}{which} at any baud rate: check the servos' power and their IDs"]
        problems = {
            i: intermittent_text(i, bus.name) if i in silent else str(error) for i, error in errors.items()
        } | causes
        return [f"{self._buses.label(j)}: {problems[j.servo_id]}" for j in joints if j.servo_id in problems]

    def measure(self) -> dict[str, Reading]:
        """Measure every servo once, with retries. Return readings keyed by joint name, with likely causes of faults."""
        readings: dict[str, Mapping[int, Reading]] = {}
        for name, bus in self._buses.buses.items():
            with self._buses.named(name):
                found, causes = read_explained_states(bus, [joint.servo_id for joint in self._buses.joints_on[name]])
                readings[name] = {i: _with_cause(reading, causes.get(i)) for i, reading in found.items()}
        return self._buses.by_joint(readings)

    def goal(self, joint: Joint) -> int:
        """Return the goal of a servo, in counts."""
        return self._ask(joint, lambda bus: bus.goal(joint.servo_id))

    def position_limits(self, joint: Joint) -> tuple[int, int] | None:
        """Return the position limits of a servo, in counts; None if it has none."""
        return self._ask(joint, lambda bus: bus.position_limits(joint.servo_id))

    def torque_is_on(self, joint: Joint) -> bool:
        """Return whether torque is enabled."""
        return self._ask(joint, lambda bus: bus.torque_is_on(joint.servo_id))

    def drives(self, joint: Joint) -> bool:
        """Return whether a servo drives or brakes its motor."""
        register = series_of(joint.model).torque_enable
        return self._ask(joint, lambda bus: retry(partial(bus.read, joint.servo_id, register))) != 0

    def forget_turns(self, joints: Sequence[Joint]) -> None:
        """Make limp servos discard the turns that they have counted but do not report."""
        log = FaultLog()
        try:
            for joint in joints:
                if joint.model in sts.MODELS.values():
                    self._ask(joint, partial(forget_turns, joint, log))
        finally:
            log.flush()

    def restart_turned(self, joint: Joint, counts: int, clock: Clock) -> bool:
        """Restart a limp servo that has counted whole turns. Return whether the servo was restarted."""

        def restarted(bus: Bus) -> bool:
            if not has_turned(joint, counts, bus) or bus.torque_is_on(joint.servo_id):
                return False
            restart(joint, clock, bus)
            return True

        return self._ask(joint, restarted)

    def limit_torque(self, joint: Joint) -> None:
        """Write the torque limit of a joint to its servo."""
        self._ask(joint, lambda bus: bus.limit_torque(joint.servo_id, joint.torque_limit))

    def write_goals_alone(self, joints: Sequence[Joint], alone: bool = True) -> None:
        """Switch joints to separate goal writes, or back to group writes."""
        for joint in joints:
            self._ask(joint, lambda bus, i=joint.servo_id: bus.write_goals_alone([i], alone))  # type: ignore[misc]

    def prepare_torque(self, joint: Joint) -> None:
        """Write the gains and other registers that a servo keeps in RAM and needs before its torque is enabled.

        If the joint is limp, measure its position after this call, because repeated requests may take a long time.
        """
        self._ask(joint, partial(_prepare_torque, joint))

    def torque_on(self, joint: Joint) -> None:
        """Enable the torque of a prepared servo."""
        self._ask(joint, lambda bus: _torque_on(joint, bus))

    def _ask(self, joint: Joint, question: Callable[[Bus], Result]) -> Result:
        with self._buses.named(joint.bus):
            return question(self._buses.buses[joint.bus])

    def torque_off(self, joints: Sequence[Joint], open_buses: OpenBuses | None = None) -> list[str]:
        """Disable the torque of joints on all buses, even if some of them fail. Return the errors.

        A bus whose port was lost is opened again by its function in ``open_buses``, because its adapter may be back.
        """
        problems: list[str] = []
        for name in self._buses.buses:
            on = [joint for joint in joints if joint.bus == name]
            try:
                problems += self._torque_off(name, on)
            except PortError as error:
                again = open_buses.get(name) if isinstance(open_buses, Mapping) else None
                problems += self._torque_off_again(name, on, again, error)
        return problems

    def _torque_off(self, name: str, joints: Sequence[Joint]) -> list[str]:
        with self._buses.named(name):
            failed = self._buses.buses[name].torque_off([joint.servo_id for joint in joints]) if joints else []
        return [self._error_text(joints, error) for error in failed]

    def _torque_off_again(
        self, name: str, joints: Sequence[Joint], open_bus: Callable[[], Bus] | None, lost: PortError
    ) -> list[str]:
        """Open a lost bus again and disable the torque of its joints. Return the errors.

        If the bus cannot be opened, the error is ``lost``.
        """
        if open_bus is None:
            return [str(lost)]
        try:
            self._buses.buses[name].close()
            self._buses.buses[name] = open_bus()
            return self._torque_off(name, joints)
        except DriverError:
            return [str(lost)]

    def _error_text(self, joints: Sequence[Joint], error: ServoError) -> str:
        if not self._buses.several:
            return str(error)
        joint = next(joint for joint in joints if joint.servo_id == error.servo_id)
        return f"{self._buses.label(joint)}: {error}"


def _failed(joints: Sequence[Joint], bus: Bus, step: Callable[[Joint, Bus], None]) -> dict[int, ServoError]:
    """Call ``step`` for all joints. Return the errors, keyed by servo ID."""
    errors: dict[int, ServoError] = {}
    for joint in joints:
        try:
            step(joint, bus)
        except ServoError as error:
            errors[joint.servo_id] = error
    return errors


def _identify(joint: Joint, bus: Bus) -> None:
    bus.identify(joint.servo_id, joint.model)
    check_mode(joint, bus)
    check_homing_offset(joint, bus)
    check_goal_current(joint, bus)


def _settle(joint: Joint, bus: Bus) -> None:
    apply_settings(joint, bus)
    limits = bus.position_limits(joint.servo_id)  # after applying the settings, which may change the limits
    if limits is None and joint.settings:  # some servos rotate continuously if both limits are 0
        bus.check_settings(joint.servo_id, joint.model)
    check_reach(joint, limits)


def forget_turns(joint: Joint, log: FaultLog, bus: Bus) -> None:
    """Make a servo discard the turns that it has counted. Some servos and adapters do not support the instruction.

    Raises:
        ServoRefused: The instruction is not supported, but it is needed because the joint can move past the servo's
            last count.
    """
    try:
        retry(lambda: bus.forget_turns(joint.servo_id))
    except (ServoSilent, ServoRefused) as error:
        retry(partial(bus.ping, joint.servo_id))  # raises an error if the servo itself is silent
        name = "the instruction 0x0A (forget turns)"
        if joint.seam_inside:
            raise ServoRefused(
                joint.servo_id,
                f"does not support {name}, but its last count is within the range of its joint: calibrate the "
                "joint so that this count is outside the range, or use an adapter that forwards the instruction",
            ) from error
        text = f"{joint.name}: servo {joint.servo_id} does not support {name}: continuing without it"
        log.note(logging.WARNING, joint.name, joint.servo_id, text)


def _prepare_torque(joint: Joint, bus: Bus) -> None:
    write_gains_in_ram(joint, bus)
    bus.prepare_torque(joint.servo_id)


def _torque_on(joint: Joint, bus: Bus) -> None:
    """Enable torque. If a Dynamixel rejects the request because it has shut down, add its alarms to the error."""
    try:
        bus.torque_on(joint.servo_id, prepared=True)
    except ServoRefused as error:
        source = series_of(joint.model).hardware_error
        alarms = source[1](retry(partial(bus.read, joint.servo_id, source[0]))) if source else ()
        if not alarms:
            raise
        raise ServoRefused(joint.servo_id, f"refuses to enable torque ({', '.join(alarms)} alarm): {REBOOT}") from error


def _wrong_voltages(joints: Sequence[Joint], bus: Bus, readings: Mapping[int, Reading]) -> dict[int, str]:
    """Return messages about servos whose voltage is outside the rated range in every reading, keyed by servo ID.

    Only a reading within the range shows that the supply is right. A lost reply shows nothing.
    """
    models, wrong = {joint.servo_id: joint.model for joint in joints}, dict[int, str]()
    for attempt in range(ATTEMPTS):
        for i, state in readings.items():
            if not isinstance(state, ServoState):
                continue
            if (fault := voltage_fault(models[i], state.voltage_v)) and fault.outside:
                wrong[i] = f"servo {i}: {fault.text}"
            else:
                wrong.pop(i, None)
        if not wrong or attempt == ATTEMPTS - 1:
            break
        readings = bus.read_states(tuple(wrong))
    return wrong


def _with_cause(reading: Reading, cause: str | None) -> Reading:
    """Replace the description of a fault with its likely cause, if known."""
    return reading._replace(text=cause) if cause and isinstance(reading, ServoFault) else reading
