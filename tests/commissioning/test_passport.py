"""Passports are read, compared and restored on a virtual bus, also with faults and torque on."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from commissioning.passport.compare import compare, take_passport
from commissioning.passport.file import HEADER, Passport, PassportError, read_passport, write_passport
from commissioning.passport.restore import Restoration, plan_replacement, plan_restore, restore, restore_all
from commissioning.provision import persistent_registers
from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError, PortLost
from drivers.servos import sts
from drivers.servos.register import Access, Register, ServoModel
from drivers.servos.x import MODELS as X_MODELS
from drivers.servos.x import startup_configuration
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus, servo_of
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.faults import Disturbance
from sim_backend.line.rig import Rig
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.sts.servo import VirtualServo

IDS = (1, 2, 3)
REBOOT = 8
OWN = {sts.position_p: 16, sts.homing_offset: -1386, sts.protection_current: 250, sts.max_acceleration: 200}


class Port(VirtualPort):
    """A port that calls ``before_write`` before each packet."""

    def __init__(self, line: VirtualBus, clock: SimulatedClock) -> None:
        super().__init__(line, clock)
        self.packets: list[bytes] = []
        self.before_write: Callable[[int], None] = lambda number: None

    def write(self, data: bytes) -> None:
        self.before_write(len(self.packets))
        self.packets.append(data)
        super().write(data)

    @property
    def writes(self) -> list[int]:
        """Addresses of all write instructions."""
        return [packet[5] for packet in self.packets if packet[4] == 3]


class Line:
    """Virtual servos with individual settings, or factory-new servos."""

    def __init__(self, ids: tuple[int, ...] = IDS, model: ServoModel = sts.STS3215, own: bool = True) -> None:
        self.clock = SimulatedClock(10.0)
        plant = BenchPlant(ids)
        plant.place([1.0 + 0.7 * i for i in range(len(ids))])
        self.servos = VirtualBus(Rig([servo_of(model, servo_id) for servo_id in ids], plant))
        self.port = Port(self.servos, self.clock)
        self.bus = Bus(self.port, self.clock, dict.fromkeys(ids, model))
        for servo in self.all if own else ():
            for register, value in OWN.items():
                servo.memory.save(register, value + servo.servo_id)

    @property
    def all(self) -> list[VirtualServo]:
        return [servo for servo in self.servos.servos if isinstance(servo, VirtualServo)]

    def held(self, servo_id: int, register: Register) -> int:
        return self.servos.servo(servo_id).memory.get(register)

    def change(self, servo_id: int, register: Register, value: int) -> None:
        servo = self.servos.servo(servo_id)
        assert isinstance(servo, VirtualServo)
        servo.memory.save(register, value)

    def lose(self, seed: int, share: float = 0.05) -> None:
        self.servos.faults.disturbance = Disturbance(seed, drop=share, flip=share, miss=share)

    def power_cycle(self) -> None:
        for servo in self.all:
            servo.power_cycle()

    def locked(self) -> bool:
        return all(servo.memory.get(sts.lock) == 1 for servo in self.all)


def passport_of(line: Line) -> Passport:
    return take_passport(line.bus)


def test_a_passport_contains_every_persistent_register(tmp_path: Path) -> None:
    line, path = Line(), tmp_path / "arm.passport.yaml"
    taken = take_passport(line.bus, joints={1: "shoulder_pan"}, adapter="5A68013201")
    write_passport(path, taken)
    assert read_passport(path) == taken
    text = yaml.safe_load(path.read_text())
    assert list(text["servos"]) == [1, 2, 3]
    assert text["servos"][2]["registers"].keys() == persistent_registers(sts.STS3215).keys()
    assert text["servos"][2]["registers"]["homing_offset"] == -1384
    assert (text["adapter"], text["servos"][1]["joint"]) == ("5A68013201", "shoulder_pan")
    assert line.port.writes == []


def test_compare_lists_every_changed_register() -> None:
    line = Line()
    taken = passport_of(line)
    assert compare(line.bus, taken).same
    line.change(2, sts.position_p, 32)
    line.change(3, sts.servo_id, 9)
    found = compare(line.bus, taken)
    assert [(one.servo_id, one.register, one.saved, one.now) for one in found.differences] == [
        (2, "position_p", 18, 32)
    ]
    assert (found.absent, found.others, found.same) == ((3,), (9,), False)


@pytest.mark.parametrize("seed", range(8))
def test_lost_packets_do_not_change_a_passport(seed: int) -> None:
    line = Line()
    taken = passport_of(line)
    line.lose(seed)
    assert passport_of(line) == taken
    assert compare(line.bus, taken).same


def test_restore_writes_only_different_values() -> None:
    line = Line()
    taken = passport_of(line)
    line.change(2, sts.homing_offset, 7)
    line.change(3, sts.position_p, 32)
    before = len(line.port.packets)
    plans = plan_restore(line.bus, taken)
    assert [(plan.servo_id, dict(plan.now)) for plan in plans] == [(2, {"homing_offset": 7}), (3, {"position_p": 32})]
    assert line.port.writes == []
    for plan in plans:
        restore(line.bus, line.clock, plan)
    lock = sts.lock.address
    assert [packet[5] for packet in line.port.packets[before:] if packet[4] == 3] == [lock, 31, lock, lock, 21, lock]
    line.power_cycle()
    assert compare(line.bus, taken).same and line.locked()


def test_a_failed_restore_lists_what_was_written() -> None:
    line = Line()
    taken = passport_of(line)
    for servo_id in IDS:
        line.change(servo_id, sts.position_p, 32)
    plans = plan_restore(line.bus, taken)
    line.servos.faults.silence(2)
    with pytest.raises(DriverError, match="servo 2") as failed:
        restore_all(line.bus, line.clock, plans)
    assert failed.value.__notes__[-2:] == [
        "already written to servo 1: position_p 32 to 17",
        "not yet written: servo 3",
    ]


def test_a_servo_silent_after_its_restart_is_listed_as_written() -> None:
    line = Line()
    taken = passport_of(line)
    line.change(2, sts.position_p, 32)
    (plan,) = plan_restore(line.bus, taken)
    line.port.before_write = lambda number: (
        line.servos.faults.silence(2) if line.port.packets and line.port.packets[-1][4] == REBOOT else None
    )
    with pytest.raises(DriverError, match="servo 2") as failed:
        restore(line.bus, line.clock, plan)
    assert "written before this error: position_p 32 to 18" in failed.value.__notes__


def test_a_single_servo_can_be_restored() -> None:
    line = Line()
    taken = passport_of(line)
    line.change(1, sts.position_p, 32)
    line.change(2, sts.position_p, 32)
    line.servos.faults.silence(3)
    (plan,) = plan_restore(line.bus, taken, 2)
    restore(line.bus, line.clock, plan)
    assert (line.held(1, sts.position_p), line.held(2, sts.position_p)) == (32, 18)


@pytest.mark.parametrize("others", [(), (1, 2), (1, 2, 8)])
@pytest.mark.parametrize("new_id", [1, 3, 8, 9])
def test_a_new_servo_replaces_an_old_one(new_id: int, others: tuple[int, ...]) -> None:
    """The new servo may be alone with any ID, or in a chain with an ID that is not in use."""
    taken = passport_of(Line())
    line = Line((*others, new_id), own=False)
    taken_or_unclear = (new_id in (1, 3) and others) or 8 in others
    if taken_or_unclear and not (others == (1, 2, 8) and new_id == 8):
        with pytest.raises(PassportError, match="nothing was written"):
            plan_replacement(line.bus, taken, 3)
        return
    if others == (1, 2, 8):  # two with ID 8
        with pytest.raises(PassportError, match="all replies are corrupted"):
            plan_replacement(line.bus, taken, 3)
        return
    plan = plan_replacement(line.bus, taken, 3)
    changes = restore(line.bus, line.clock, plan)
    assert new_id == 3 or changes[-1].register.name == "id"
    line.power_cycle()
    assert line.all[-1].servo_id == 3 and line.locked()
    now = take_passport(line.bus, {3: sts.STS3215})
    assert now.servos[3].registers == taken.servos[3].registers


@pytest.mark.parametrize("seed", range(6))
def test_a_new_servo_is_restored_over_a_lossy_bus(seed: int) -> None:
    taken, line = passport_of(Line()), Line((1,), own=False)
    line.lose(seed)
    for _ in range(3):  # each run continues with the remaining registers
        try:
            restore(line.bus, line.clock, plan_replacement(line.bus, taken, 3))
            break
        except DriverError:
            continue
    line.servos.faults.disturbance = None
    line.power_cycle()
    assert take_passport(line.bus, {3: sts.STS3215}).servos[3].registers == taken.servos[3].registers
    assert line.locked()


@pytest.mark.parametrize("cut", range(2, 60, 3))
def test_a_second_run_completes_a_restore_after_a_power_cut(cut: int) -> None:
    taken, line = passport_of(Line()), Line((1,), own=False)
    plan = plan_replacement(line.bus, taken, 3)
    begun = len(line.port.packets)

    def meddle(number: int) -> None:
        if number == begun + cut:
            line.power_cycle()
            line.all[0].firmware.deaf_s = 0.5

    line.port.before_write = meddle
    try:
        restore(line.bus, line.clock, plan)
    except DriverError:
        line.clock.sleep_until(line.clock.now() + 1.0)
        plan = plan_replacement(line.bus, taken, 3)
        restore(line.bus, line.clock, plan)
    line.power_cycle()
    line.clock.sleep_until(line.clock.now() + 1.0)
    assert take_passport(line.bus, {3: sts.STS3215}).servos[3].registers == taken.servos[3].registers
    assert line.locked()


@pytest.mark.parametrize("lost", range(2, 40, 4))
def test_a_second_run_completes_a_restore_after_a_lost_port(lost: int) -> None:
    taken, line = passport_of(Line()), Line((1,), own=False)
    plan = plan_replacement(line.bus, taken, 3)
    begun = len(line.port.packets)
    line.port.before_write = lambda number: line.port.unplug() if number == begun + lost else None
    with pytest.raises(PortLost):
        restore(line.bus, line.clock, plan)
    line.port = Port(line.servos, line.clock)
    line.bus = Bus(line.port, line.clock)
    restore(line.bus, line.clock, plan_replacement(line.bus, taken, 3))
    line.power_cycle()
    assert take_passport(line.bus, {3: sts.STS3215}).servos[3].registers == taken.servos[3].registers


def test_a_servo_with_torque_on_is_named_and_nothing_is_written() -> None:
    line = Line()
    taken = passport_of(line)
    line.change(1, sts.position_p, 32)
    line.servos.servo(2).memory.put(sts.torque_enable, 1)
    with pytest.raises(PassportError, match=r"servo 2 has torque enabled[^$]*nothing was written"):
        plan_restore(line.bus, taken)
    assert line.port.writes == []


def test_torque_enabled_after_planning_prevents_the_write() -> None:
    line = Line()
    taken = passport_of(line)
    line.change(2, sts.position_p, 32)
    (plan,) = plan_restore(line.bus, taken)
    line.servos.servo(2).memory.put(sts.torque_enable, 1)
    with pytest.raises(DriverError, match="the torque of the servo is enabled"):
        restore(line.bus, line.clock, plan)
    assert line.held(2, sts.position_p) == 32


def test_another_model_is_refused() -> None:
    taken = passport_of(Line())
    line = Line((1,), sts.STS3250, own=False)
    with pytest.raises(PassportError, match=r"servo 1 has model number 2825 \(sts3250\), not 777 \(sts3215\); nothing"):
        plan_replacement(line.bus, taken, 3)
    with pytest.raises(
        PassportError, match=r"servo 1 has model number 2825[^$]*servo 2 does not respond[^$]*nothing was written"
    ):
        plan_restore(line.bus, taken)


def test_all_missing_servos_are_named_at_once() -> None:
    line = Line()
    taken = passport_of(line)
    line.servos.faults.silence(1)
    line.servos.faults.silence(3)
    with pytest.raises(PassportError, match=r"servo 1 does not respond: .*\nservo 3 does not respond"):
        plan_restore(line.bus, taken)
    with pytest.raises(PassportError, match=r"servo 1 does not respond: .*\nservo 3 does not respond"):
        take_passport(line.bus, dict.fromkeys(IDS, sts.STS3215))


def test_a_duplicate_id_is_refused() -> None:
    line = Line((1, 2, 3, 3), own=False)
    with pytest.raises(PassportError, match="servo 3: all replies are corrupted"):
        passport_of(line)


def test_an_empty_bus_is_reported() -> None:
    line = Line()
    for servo_id in IDS:
        line.servos.faults.silence(servo_id)
    with pytest.raises(PassportError, match="no servo responds on virtual at 1000000 baud"):
        passport_of(line)


def test_identity_registers_are_not_written() -> None:
    line = Line()
    taken = passport_of(line).model_dump()
    taken["servos"][2]["registers"] |= {"baud_rate": 1, "firmware_minor": 3, "position_p": 40}
    (plan,) = plan_restore(line.bus, Passport.model_validate(taken))
    assert {register.name for register in plan.values} == {"position_p"}


def test_a_dynamixel_has_a_passport() -> None:
    model = X_MODELS["xl430-w250"]
    clock = SimulatedClock(10.0)
    line = VirtualDynamixelBus.of(BenchPlant((1, 2)), dict.fromkeys((1, 2), model))
    bus = Bus(VirtualPort(line, clock), clock, dict.fromkeys((1, 2), model))
    taken = take_passport(bus, dict.fromkeys((1, 2), model))
    assert compare(bus, taken).same
    wanted = taken.model_dump()
    wanted["servos"][2]["registers"]["homing_offset"] = -70
    plans = plan_restore(bus, Passport.model_validate(wanted))
    assert [restore(bus, clock, plan)[0].new for plan in plans] == [-70]
    assert compare(bus, Passport.model_validate(wanted)).same


def test_a_passport_keeps_the_startup_configuration_and_an_older_passport_lacks_it() -> None:
    model = X_MODELS["xl430-w250"]
    clock = SimulatedClock(10.0)
    line = VirtualDynamixelBus.of(BenchPlant((1,)), {1: model})
    bus = Bus(VirtualPort(line, clock), clock, {1: model})
    bus.write(1, startup_configuration, 2)
    taken = take_passport(bus, {1: model}).model_dump()
    assert taken["servos"][1]["registers"].pop("startup_configuration") == 2
    assert compare(bus, Passport.model_validate(taken)).same


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("position_p: 17", "position_p: 300", "position_p must be 0 to 254, not 300"),
        ("position_p: 17", "position_q: 17", "sts3215 has no persistent register position_q; register position_p is"),
        ("model: sts3215", "model: sts9", "unknown model sts9"),
        ("model_number: 777", "model_number: 778", "model_number is 778, but an sts3215 has 777"),
        ("    id: 1\n", "    id: 4\n", "servo 1: its id register contains a different ID"),
        ("\n...\n", "\n", "the file is truncated"),
        ("baud: 1000000", "baud: [", "is not YAML"),
    ],
)
def test_a_broken_file_is_refused_with_its_mistakes(tmp_path: Path, old: str, new: str, text: str) -> None:
    path = tmp_path / "passport.yaml"
    write_passport(path, passport_of(Line()))
    whole = path.read_text()
    assert old in whole
    path.write_text(whole.replace(old, new, 1))
    with pytest.raises(PassportError, match=text):
        read_passport(path)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "passport.yaml"
    write_passport(path, passport_of(Line()))
    whole = path.read_text()
    for end in range(0, len(whole) - 1, 37):
        path.write_text(whole[:end])
        with pytest.raises(PassportError, match="the file is truncated" if end > len(HEADER) else None):
            read_passport(path)


def test_the_former_file_is_kept(tmp_path: Path) -> None:
    line, path = Line(), tmp_path / "passport.yaml"
    first = passport_of(line)
    write_passport(path, first)
    line.change(1, sts.position_p, 40)
    write_passport(path, passport_of(line))
    assert read_passport(tmp_path / "passport.yaml.1") == first
    with pytest.raises(PassportError, match=r"cannot write .*: No such file or directory$"):
        write_passport(tmp_path / "nowhere" / "passport.yaml", first)


def test_only_writable_registers_are_in_a_plan() -> None:
    """The servo differs from the passport in every register."""
    line = Line()
    taken = passport_of(line).model_dump()
    for name, register in persistent_registers(sts.STS3215).items():
        if name not in ("id", "model_number", "status_level"):
            taken["servos"][1]["registers"][name] = max(register.smallest, taken["servos"][1]["registers"][name] - 1)
    plan: Restoration = next(p for p in plan_restore(line.bus, Passport.model_validate(taken)) if p.servo_id == 1)
    assert all(r.access is Access.READ_WRITE and r.persistent and r.name != "baud_rate" for r in plan.values)
    assert sts.homing_offset in plan.values
