"""Six new servos with ID 1 are set up as an arm, even if the user connects wrong servos."""

import re
from collections.abc import Callable

import pytest

from commissioning.set_up.flow import TRIES, SetUp, SetUpTask
from commissioning.set_up.only_one import ServoPlace, SetUpError, in_order, places_of
from drivers.driver_errors import DriverError, PortLost
from drivers.servos import sts, x
from drivers.servos.register import ServoModel
from servoloop.stack.arm_folders import find_arm, read_arm_files
from sim_backend.faults import Disturbance
from tests.commissioning.box import GRIPPER, JOINTS, Bench, Hands, places
from tests.pages import code

WRITE = 0x03


def assert_set_up(bench: Bench) -> None:
    """Check that every servo has its values in flash and is locked."""
    assert bench.box.ids() == [1, 2, 3, 4, 5, 6]
    assert bench.locked()
    for number, place in enumerate(places()):
        for register, value in place.wanted().items():
            assert bench.held(number, register) == value, (place.joint, register.name)


@pytest.mark.parametrize("seed", range(3))
def test_six_new_servos_are_set_up(seed: int) -> None:
    bench = Bench(seed)
    hands = Hands(bench)
    audit = bench.set_up(hands).run()
    assert [task.joint for task in hands.asked] == [*reversed(JOINTS), ""]
    assert hands.problems == []
    assert [(one.joint, one.servo_id, one.from_id) for one in audit] == [(n, i, 1) for i, n in enumerate(JOINTS, 1)]
    written = {change.register.name: (change.old, change.new) for change in audit[-1].changes}
    assert written == {"return_delay": (250, 0), "position_p": (32, 16), "protection_current": (310, 250),
                       "max_torque": (1000, 500), "id": (1, 6)}  # fmt: skip
    assert list(written)[-1] == "id"
    assert 11.5 < audit[0].voltage_v < 12.5
    assert_set_up(bench)


def test_a_second_run_over_the_chain_changes_nothing() -> None:
    bench = Bench()
    bench.set_up(Hands(bench)).run()
    bench.port.before_write = refuse_writes
    hands = Hands(bench)
    audit = bench.set_up(hands).run()
    assert hands.asked == []
    assert {(one.changes, one.from_id) for one in audit} == {((), None)}


@pytest.mark.runs("setup.md python 1")
def test_the_program_of_the_page_sets_up_an_arm_s_servos() -> None:
    bench = Bench()
    path = read_arm_files(find_arm("so101_12v")).robot_path
    names = {"bus": bench.bus, "clock": bench.clock, "path": path, "guide": Hands(bench)}
    exec(code("setup.md", "python"), names)
    assert [one.servo_id for one in names["audit"]] == bench.box.ids()  # type: ignore[attr-defined]
    assert bench.locked()


def refuse_writes(data: bytes) -> None:
    assert data[4] != WRITE


def test_a_second_run_recognizes_single_servos() -> None:
    bench = Bench()
    bench.set_up(Hands(bench)).run()
    bench.box.connect()
    hands = Hands(bench)
    bench.port.before_write = refuse_writes
    audit = bench.set_up(hands).run()
    assert len(hands.asked) == len(JOINTS) + 1
    assert {one.changes for one in audit} == {()}


@pytest.mark.parametrize("after", range(7))
def test_an_interrupted_set_up_continues_where_it_stopped(after: int) -> None:
    bench = Bench()

    def stop(task: SetUpTask) -> None:
        if len(hands.asked) > after:
            raise KeyboardInterrupt

    hands = Hands(bench, instead=stop)
    set_up = bench.set_up(hands)
    with pytest.raises(KeyboardInterrupt):
        set_up.run()
    assert len(set_up.done) == min(after, 6)
    assert bench.locked()
    done = list(reversed(range(6)))[:after]
    bench.box.connect(*done)  # a user also leaves the finished servos in the chain
    hands = Hands(bench)
    bench.set_up(hands).run()
    asked = [task.joint for task in hands.asked if task.kind == "one"]
    assert asked == list(reversed(JOINTS))[after:]
    assert_set_up(bench)


def once(joint: str, *numbers: int) -> Callable[[SetUpTask], tuple[int, ...] | None]:
    """Connect other servos when the joint is requested for the first time."""
    return lambda task: numbers if task.joint == joint and not task.problem else None


@pytest.mark.parametrize(
    ("instead", "text"),
    [
        (once("wrist_roll"), "no servo responds on virtual at any baud rate"),
        (once("wrist_roll", 4, 3), "all replies of servo 1 are corrupted: either several servos have ID 1"),
        (once("wrist_roll", 4, 5), r"several servos respond \(IDs 1, 6\): connect only one"),
        (once("wrist_roll", 5), "has ID 6, so it already belongs to gripper"),
        (once("shoulder_pan", 0, 1, 2, 3, 4, 5), "several servos respond"),
    ],
)
def test_a_wrong_connection_is_reported_and_requested_again(
    instead: Callable[[SetUpTask], tuple[int, ...] | None], text: str
) -> None:
    bench = Bench()
    hands = Hands(bench, instead=instead)
    bench.set_up(hands).run()
    assert len(hands.problems) == 1
    assert re.search(text, hands.problems[0])
    assert_set_up(bench)


def test_an_incomplete_chain_is_reported() -> None:
    bench = Bench()
    hands = Hands(bench, instead=lambda task: (0, 1, 3) if task.kind == "chain" and not task.problem else None)
    bench.set_up(hands).run()
    assert hands.problems == [
        "elbow_flex (servo 3) does not respond: check its cable\n"
        "wrist_roll (servo 5) does not respond: check its cable\n"
        "gripper (servo 6) does not respond: check its cable"
    ]


def test_the_number_of_requests_is_limited() -> None:
    bench = Bench()
    hands = Hands(bench, instead=lambda task: ())
    with pytest.raises(SetUpError, match="gripper: no servo responds"):
        bench.set_up(hands).run()
    assert len(hands.asked) == TRIES


@pytest.mark.parametrize("rate", [500_000, 115_200, 38_400])
def test_a_servo_at_another_rate_gets_the_bus_rate(rate: int) -> None:
    bench = Bench()
    bench.servo(3).memory.save(sts.baud_rate, sts.BAUD_RATES.index(rate))
    bench.servo(3).memory.save(sts.servo_id, 77)
    audit = bench.set_up(Hands(bench)).run()
    assert (audit[3].from_baud, audit[3].from_id) == (rate, 77)
    assert bench.held(3, sts.baud_rate) == 0
    assert_set_up(bench)


def test_a_servo_in_wheel_mode_is_set_to_position_mode() -> None:
    bench = Bench()
    bench.servo(2).memory.save(sts.operating_mode, 1)
    bench.servo(2).memory.save(sts.status_level, 0)
    bench.set_up(Hands(bench)).run()
    assert (bench.held(2, sts.operating_mode), bench.held(2, sts.status_level)) == (0, 1)
    assert_set_up(bench)


def test_another_model_is_reported() -> None:
    bench = Bench()
    bench.servo(5).memory.save(sts.model_number, 2825)
    hands = Hands(bench)

    def swap(task: SetUpTask) -> None:
        if task.problem:
            bench.servo(5).memory.save(sts.model_number, 777)

    hands.instead = swap
    bench.set_up(hands).run()
    assert hands.problems == [
        "servo 1 has model number 2825 (sts3250), but gripper needs an sts3215 (777) according to the "
        "robot file. Connect the right servo, or correct the robot file"
    ]
    assert_set_up(bench)


@pytest.mark.parametrize(
    ("model", "supply_v", "text"),
    [
        (sts.STS3215_C001, 12.0, "12.0 V is too high for an sts3215_c001, which is rated for 7.4 V"),
        (sts.STS3215, 5.0, "5.0 V is too low for an sts3215, which is rated for 12.0 V"),
        (sts.STS3215, 16.0, "16.0 V is too high for an sts3215, which is rated for 12.0 V"),
    ],
)
def test_a_wrong_supply_ends_the_set_up_without_writes(model: ServoModel, supply_v: float, text: str) -> None:
    bench = Bench(model=model, supply_v=supply_v)
    bench.port.before_write = refuse_writes
    hands = Hands(bench)
    with pytest.raises(SetUpError, match=text):
        SetUp(bench.bus, bench.clock, places(model), hands).run()
    assert len(hands.asked) == 1


def test_a_servo_with_lower_voltage_limits_is_refused() -> None:
    """Both servos have the same model number, but different voltage limits."""
    bench = Bench(model=sts.STS3215_C001, supply_v=12.0)
    with pytest.raises(SetUpError, match=r"measures 12.0 V, but its own limits are 4.0 to 8.0 V"):
        SetUp(bench.bus, bench.clock, places(sts.STS3215), Hands(bench)).run()


def test_7_v_servos_are_set_up_at_their_voltage() -> None:
    bench = Bench(model=sts.STS3215_C001)
    SetUp(bench.bus, bench.clock, places(sts.STS3215_C001), Hands(bench)).run()
    assert_set_up(bench)


def test_a_servo_with_torque_on_is_not_changed() -> None:
    bench = Bench()
    hands = Hands(bench)
    bench.box.connect(5)
    bench.clock.sleep_until(11.0)
    bench.servo(5).memory.put(sts.torque_enable, 1)
    bench.port.before_write = refuse_writes

    def stay(task: SetUpTask) -> tuple[int, ...] | None:
        if task.problem:
            assert bench.servo(5).memory.get(sts.torque_enable) == 1
            raise KeyboardInterrupt
        return None

    hands.instead = stay
    with pytest.raises(KeyboardInterrupt):
        bench.set_up(hands).run()
    assert "the torque of servo 1 is enabled" in hands.problems[0]


@pytest.mark.parametrize("seed", range(4))
def test_a_lossy_bus_only_takes_longer(seed: int) -> None:
    bench = Bench(seed)
    bench.box.line.faults.disturbance = Disturbance(seed, drop=0.04, flip=0.02, miss=0.02)
    for _ in range(4):
        try:
            bench.set_up(Hands(bench)).run()
            break
        except DriverError:
            continue
    bench.box.line.faults.disturbance = None
    assert_set_up(bench)


class Cut:
    """Call a function at the n-th write instruction of a run."""

    def __init__(self, at: int, what: Callable[[], None]) -> None:
        self.left, self.what = at, what

    def __call__(self, data: bytes) -> None:
        if data[4] == WRITE:
            self.left -= 1
            if self.left == -1:
                self.what()


def interrupt() -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("at", range(0, 20, 4))
def test_an_interrupted_write_leaves_the_eeprom_locked(at: int) -> None:
    bench = Bench()
    bench.servo(4).memory.save(sts.baud_rate, 4)  # the second servo in the order, which also needs a new baud rate
    bench.port.before_write = Cut(at, interrupt)
    with pytest.raises(KeyboardInterrupt):
        bench.set_up(Hands(bench)).run()
    assert bench.locked()
    assert not any(bench.servo(number).memory.get(sts.torque_enable) for number in range(6))
    bench.port.before_write = lambda data: None
    bench.set_up(Hands(bench)).run()
    assert_set_up(bench)


@pytest.mark.parametrize("at", range(0, 20, 4))
def test_the_set_up_continues_after_a_lost_port(at: int) -> None:
    bench = Bench()
    bench.servo(4).memory.save(sts.baud_rate, 4)
    bench.port.before_write = Cut(at, bench.port.unplug)
    with pytest.raises(PortLost):
        bench.set_up(Hands(bench)).run()
    bench.open()
    bench.box.connect()
    bench.set_up(Hands(bench)).run()
    assert_set_up(bench)


@pytest.mark.parametrize("at", range(0, 20, 4))
def test_the_set_up_recovers_from_a_power_cut(at: int) -> None:
    bench = Bench()

    def cut() -> None:
        for number in range(6):
            bench.servo(number).power_cycle()
            bench.servo(number).firmware.deaf_s = 0.5

    bench.port.before_write = Cut(at, cut)
    bench.set_up(Hands(bench)).run()
    assert_set_up(bench)


def test_the_servo_with_the_factory_id_comes_last() -> None:
    odd = [ServoPlace("a", 4, sts.STS3215), ServoPlace("b", 1, sts.STS3215), ServoPlace("c", 2, sts.STS3215, GRIPPER)]
    assert [place.joint for place in in_order(odd)] == ["c", "a", "b"]


def test_a_dynamixel_that_was_calibrated_in_extended_position_mode_keeps_it() -> None:
    file = read_arm_files(find_arm("koch")).robot.file
    joints = {name: joint.model_copy(update={"extended": name == "gripper"}) for name, joint in file.joints.items()}
    wanted = places_of(file.model_copy(update={"joints": joints}))
    modes = {place.joint: place.basics()[x.operating_mode] for place in wanted}
    assert modes == {name: 4 if name == "gripper" else 3 for name in joints}
