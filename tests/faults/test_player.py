"""Faults begin and end in the right millisecond, and can overlap. After a fault, the previous state is restored."""

from dataclasses import replace
from itertools import product
from random import Random
from typing import Any

import pytest

from drivers.driver_errors import PortLost, PortMissing
from drivers.servos import ax_mx, scs, sts, x, xl320
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import PROTOCOL_2
from drivers.servos.register import ServoModel
from hal.lifecycle import LifecycleState
from servoloop.simulation.stack_faults import inventory_of
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualAdapter
from sim_backend.clock import SimulatedClock
from sim_backend.faults.draw import draw
from sim_backend.faults.events import KINDS
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.targets import FaultTargets
from sim_backend.faults.text import matching, parse, text_of
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.sts import Code, checksum
from tests.faults.rig import FaultRig, files_of, told

IDS = (1, 2, 3)


def up() -> FaultRig:
    rig = FaultRig()
    rig.up()
    return rig


class Bench:
    """Three STS servos on a line that runs one millisecond per step."""

    def __init__(self) -> None:
        self.line = VirtualBus.of(BenchPlant(IDS))
        self.player = FaultPlayer(FaultTargets({"": self.line}))
        self.ms = 0

    def play(self, *texts: str) -> None:
        self.player.play([parse(text) for text in texts], self.ms / 1000.0)

    def until(self, ms: int) -> None:
        while self.ms < ms:
            self.ms += 1
            self.line.rig.step()
            self.player.update(self.ms / 1000.0)

    def reply(self, servo_id: int) -> bytes:
        """Return the reply to a ping, whose bytes take no time."""
        body = bytes((servo_id, 2, Code.PING))
        self.line.paced = False
        now_s = self.line.reached_s
        return b"".join(r.data for r in self.line.receive(b"\xff\xff" + body + bytes((checksum(body),)), now_s))


def test_a_fault_starts_and_ends_in_the_right_millisecond() -> None:
    bench = Bench()
    bench.play("silent id=2 at=100ms for=50ms")
    heard = []
    for ms in range(1, 200):
        bench.until(ms)
        if not bench.reply(2):
            heard.append(ms)
    assert heard == list(range(100, 150))
    assert not bench.player.active and not bench.player.coming


def test_a_shared_fault_lasts_until_the_last_holder_ends() -> None:
    bench = Bench()
    bench.play("silent id=2 for=100ms", "silent id=2 at=50ms for=100ms")
    bench.until(120)
    assert not bench.reply(2)
    bench.until(160)
    assert bench.reply(2)


def test_the_newest_value_applies_and_then_the_previous_one() -> None:
    bench = Bench()
    voltages = []
    bench.play("weak_supply voltage=9 for=300ms", "weak_supply voltage=7 at=100ms for=100ms")
    for ms in (50, 150, 250, 350):
        bench.until(ms)
        voltages.append(round(bench.line.servo(1).firmware.voltage_v, 1))
    assert voltages == [9.0, 7.0, 9.0, 12.0]


def test_a_silent_servo_stays_silent_under_another_id() -> None:
    bench = Bench()
    bench.play("silent id=2", "wrong_id id=2 to=9 at=10ms for=10ms")
    bench.until(15)
    assert not bench.reply(9) and bench.line.servos[1].servo_id == 9
    bench.until(25)
    assert not bench.reply(2) and bench.line.servos[1].servo_id == 2


MODELS = (sts.STS3215, scs.SCS0009, ax_mx.AX_12A, ax_mx.MX_28, x.XL430_W250, x.XL330_M288, xl320.XL320)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_servos_of_each_series_accept_or_refuse_each_kind(model: ServoModel) -> None:
    """After the fault the servos answer as before, except for permanent changes."""
    made = VirtualDynamixelBus.of if series_of(model).protocol is PROTOCOL_2 else VirtualBus.of
    for kind, number in product(sorted(KINDS), range(3)):
        line: ServoLine[Any] = made(BenchPlant(IDS), dict.fromkeys(IDS, model))
        player = FaultPlayer(FaultTargets({"": line}))
        before = [(servo.servo_id, servo.baud) for servo in line.servos]
        try:
            player.play([KINDS[kind].drawn(Random(number), player.targets.inventory, 0.001)])
        except FaultError as refused:
            assert "\n" not in str(refused)
            continue
        for ms in range(20):
            line.rig.step()
            player.update(0.001 * ms)
        player.close()
        if kind != "eeprom_gone":
            assert [(servo.servo_id, servo.baud) for servo in line.servos] == before, kind
            assert not line.faults.on_reply and not line.faults.on_arrival and not line.faults.on_instruction
        else:
            assert [servo.servo_id for servo in line.servos].count(1) in (1, 2)


def test_closing_ends_everything() -> None:
    bench = Bench()
    usual = bench.line.servo(1).firmware.voltage_v
    bench.play(
        "silent id=2", "weak_supply voltage=7", "noise", "echo", "cable_cut after=2", "wrong_rate id=1 baud=57600"
    )
    bench.until(10)
    assert len(bench.player.active) == 6
    bench.player.close()
    bench.until(1000)
    assert all(bench.reply(i)[:2] == b"\xff\xff" and len(bench.reply(i)) == 6 for i in IDS)
    assert bench.line.servo(1).firmware.voltage_v == usual


def test_one_impossible_fault_prevents_the_whole_list() -> None:
    bench = Bench()
    with pytest.raises(FaultError) as refused:
        bench.play("silent id=2", "silent id=4", "jammed id=1", "stall for=1", "adapter_unplugged", "cable_cut after=3")
    said = str(refused.value)
    assert len(said.splitlines()) == 5
    for why in (
        "no servo 4; known servos: 1, 2, 3",
        "there is no simulated arm here",
        "no stack",
        "no adapter",
        "servo 3 is the last",
    ):
        assert why in said
    bench.until(10)
    assert bench.reply(2)


def test_a_fault_of_an_unknown_controller_is_refused() -> None:
    rig = FaultRig()
    there = rig.player.targets.inventory
    assert there.servos == inventory_of(rig.files).servos
    assert list(there.servos[""]) == list(range(1, 8))
    with pytest.raises(FaultError, match="no controller 'nobody'; known controllers"):
        rig.play(parse("controller_nan controller=nobody"))


def test_servos_from_the_box_cannot_be_named() -> None:
    with pytest.raises(FaultError, match="all servos of a box have the same ID"):
        FaultPlayer(FaultTargets({})).play([parse("echo")])


def test_the_same_faults_give_the_same_bytes() -> None:
    schedule = [
        parse(text) for text in ("flipped_replies chance=0.2", "noise chance=0.2", "missed_instructions chance=0.1")
    ]
    wires: list[list[Any]] = []
    for _ in range(2):
        rig = up()
        rig.play(*schedule)
        rig.endure(0.5)
        port = next(iter(rig.ports.values()))
        wires.append([port.sent, port.received, rig.world.position().tolist()])
    assert wires[0] == wires[1]


def test_a_drawn_schedule_of_all_kinds_does_not_end_the_loop() -> None:
    rig = up()
    schedule = draw(1, replace(rig.player.targets.inventory, start_s=None, end_s=None), 1.0, 40)
    rig.play(*schedule)
    rig.endure(1.5)
    assert not rig.player.coming
    assert not rig.says("ended:"), [text_of(event) for event in schedule]


@pytest.mark.parametrize("back", ["", " as=/dev/ttyACM7"])
def test_an_adapter_is_reopened_only_under_its_own_name(back: str) -> None:
    rig = told("robot_arm", parse(f"adapter_unplugged for=300ms{back}"), seconds=0.1)
    assert not rig.says("measured again")  # the servos are not read
    component = rig.made[0]
    assert component.state is LifecycleState.UNCONFIGURED
    rig.endure(0.3)
    asked = rig.loop.component_transitions.ask(component.name, LifecycleState.ACTIVE)
    rig.endure(0.5)
    if back:
        with pytest.raises(PortMissing, match="/dev/ttyACM7"):
            asked.result()
    else:
        assert component.state is LifecycleState.ACTIVE


def test_a_lost_port_stays_lost_after_replugging() -> None:
    adapter = VirtualAdapter(VirtualBus.of(BenchPlant(IDS)), SimulatedClock(), "/dev/ttyACM0")
    port = adapter.open("/dev/ttyACM0")
    adapter.unplug()
    adapter.plug()
    with pytest.raises(PortLost):
        port.write(b"")
    assert adapter.open("/dev/ttyACM0").is_open
    adapter.unplug()
    with pytest.raises(PortMissing, match="present: none"):
        adapter.open("/dev/ttyACM0")


def test_jammed_gears_block_the_joint_until_the_fault_ends() -> None:
    rig = up()
    inertia = rig.world.model.dof_armature.copy()
    rig.play(parse("jammed id=2 for=1s"), parse("jammed id=2 at=500ms for=1s"))
    rig.endure(0.1)
    before = rig.world.position()
    rig.go([position + 0.2 for position in before[:6]], 1.0)
    rig.endure(1.2)
    after = rig.world.position()
    assert abs(after[1] - before[1]) < 1e-4 < abs(after[0] - before[0])
    rig.endure(0.5)
    assert (rig.world.model.dof_armature == inertia).all()


def test_a_slipped_horn_moves_the_joint_but_not_the_counts() -> None:
    rig = up()
    rig.run(0.3)
    before = rig.world.position()[0]
    rig.play(parse("slipped_horn id=1 counts=100"))
    rig.endure(1.0)
    joint = files_of("robot_arm").robot.joints[0]
    assert rig.world.position()[0] - before == pytest.approx(-100 * joint.units_per_count, abs=0.01)


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("", []),
        ("silent", ["hot id=2 temperature=95.0 at=5.0s"]),
        ("silent id=3", ["silent id=1", "hot id=2 temperature=95.0 at=5.0s"]),
        ("hot temperature=95", ["silent id=1", "silent id=3 for=2.0s"]),
    ],
)
def test_faults_are_ended_by_kind_and_parameters(text: str, left: list[str]) -> None:
    bench = Bench()
    bench.play("silent id=1", "silent id=3 for=2s", "hot id=2 temperature=95 at=5s")
    bench.until(10)
    bench.player.cancel(matching(text))
    assert [text_of(one) for one in (*bench.player.active.values(), *bench.player.coming)] == left
    bench.until(6000)
    assert bench.reply(3) and bool(bench.reply(1)) == ("silent id=1" not in left)


@pytest.mark.parametrize("text", ["sillent", "silent idd=3", "silent 3"])
def test_invalid_faults_to_end_are_refused(text: str) -> None:
    with pytest.raises(FaultError, match=r"there is no fault|silent has only the parameters id="):
        matching(text)
