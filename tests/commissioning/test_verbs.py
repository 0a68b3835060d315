"""The commands of docs/tools.md on a pseudo-terminal in real time."""

import json
import os
import re
import shlex
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from drivers.driver_errors import DriverError
from drivers.eeprom import Eeprom, EepromError
from drivers.port.serial_port import SerialPort
from drivers.servos import sts, x
from drivers.servos.register import Register
from hal.joint import Joint
from hal.servos.servo_settings import settings_of
from servoloop import cli
from servoloop.stack.arm_folders import find_arm, read_arm_files
from sim_backend.line.line import ServoLine
from tests.commissioning.machines import SmallMachine
from tests.commissioning.served import run, served
from tests.pages import code, commands

PAGE = "tools.md"
DEVICE = "/dev/ttyACM0"


WHOLE_ARM = (
    "servoloop setup --arm so101 --port /dev/ttyACM0",
    "servoloop passport save arm.passport.yaml --arm so101 --port /dev/ttyACM0",
    "servoloop passport restore arm.passport.yaml --id 6 --to-new --port /dev/ttyACM0",
    "servoloop calibration import my_arm.json --arm so101",
)
"""Commands of the page that need the servos of a certain arm."""


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "bus"


@pytest.fixture
def bus(link: Path) -> Iterator[ServoLine[Any]]:
    with served(link, dict.fromkeys(range(1, 8), sts.STS3215)) as bus:
        yield bus


EACH = [command for command in commands(PAGE) if command not in WHOLE_ARM]


@pytest.mark.slow
@pytest.mark.runs(*EACH)
def test_every_command_of_the_page_works(
    bus: ServoLine[Any], link: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    small = SmallMachine(tmp_path / "machine")
    small.plug(str(link))
    monkeypatch.setattr("commissioning.ports.adapters.Machine", lambda: small.machine)
    monkeypatch.setattr("commissioning.ports.plugging.Machine", lambda: small.machine)
    monkeypatch.setattr("commissioning.ports.plugging.SETTLE_S", 0.05)
    verbs = {shlex.split(command)[1] for command in EACH}
    assert verbs == {"ports", "scan", "register", "set-id", "set-baud", "factory-reset", "reboot"}
    for command in EACH:
        if "--wait" in command:
            threading.Timer(0.4, small.infos.append, (small.infos.pop(),)).start()
        status = run(monkeypatch, *shlex.split(command.replace(DEVICE, str(link)))[1:], answer="y\n")
        said = capsys.readouterr()
        assert status == 0, (command, said)
        assert said.out.strip(), command
    assert sorted(servo.servo_id for servo in bus.servos) == [1, 2, 3, 4, 5, 6, 8]
    third = bus.servo(3)
    assert (third.baud, third.memory.get(sts.max_temperature), third.memory.get(sts.torque_enable)) == (10**6, 70, 0)


@pytest.mark.slow
@pytest.mark.runs(*WHOLE_ARM)
def test_the_commands_of_the_page_for_a_whole_arm_work(
    link: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # folder with the files of the page
    arm = find_arm("so101")
    joints = read_arm_files(arm).robot.joints
    shutil.copytree(arm.folder, "mine")  # a calibration is stored in this folder
    Path("my_arm.json").write_text(json.dumps({one.name: as_lerobot_has_it(one) for one in joints}))
    models = {joint.servo_id: joint.model for joint in joints}
    for command, there in zip(WHOLE_ARM, (models, models, {1: models[6]}, models), strict=True):
        typed = command.replace(DEVICE, str(link))
        if "import" in command:
            typed = typed.replace("--arm so101", "--arm ./mine")
        with served(link, there) as bus:
            if len(there) > 1:  # these servos are already set up
                hold_settings(bus, joints)
            status = run(monkeypatch, *shlex.split(typed)[1:], answer="y\n" * 9)
            ids = sorted(servo.servo_id for servo in bus.servos)
        assert status == 0, (command, capsys.readouterr())
        assert ids == ([6] if "--to-new" in command else sorted(models))


def as_lerobot_has_it(joint: Joint) -> dict[str, int]:
    """Return LeRobot's entry of a joint that was moved through its whole range."""
    half = round(0.5 * (joint.limits.upper - joint.limits.lower) / abs(joint.units_per_count))
    return {
        "id": joint.servo_id,
        "drive_mode": 0,
        "homing_offset": -300,
        "range_min": 2048 - half,
        "range_max": 2047 + half,
    }


def hold_settings(bus: ServoLine[Any], joints: Sequence[Joint]) -> None:
    """Give the servos the settings of the robot file."""
    for joint in joints:
        for name, value in joint.settings:
            bus.servo(joint.servo_id).memory.save(settings_of(joint.model)[name], value)


@pytest.mark.runs(f"{PAGE} python 1")
def test_the_script_of_the_page_runs(bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exec(code(PAGE, "python").replace(DEVICE, str(link)), {})
    assert capsys.readouterr().out.splitlines() == [f"{i} sts3215 70 °C" for i in (1, 2, 3)]


def test_a_register_is_printed_in_its_unit_and_raw(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    where = ("--port", str(link), "--id", "3")
    assert run(monkeypatch, "register", "read", *where, "present_voltage") == 0
    assert capsys.readouterr().out == "present_voltage 12 V (raw 120)\n"
    assert run(monkeypatch, "register", "read", *where, "max_voltage", "--json") == 0
    value = json.loads(capsys.readouterr().out)
    assert (value["raw"], value["value"], value["unit"]) == (140, 14.0, "V")
    assert run(monkeypatch, "register", "list", *where, "--json") == 0
    assert len(json.loads(capsys.readouterr().out)) == len(sts.REGISTERS)
    assert run(monkeypatch, "register", "write", *where, "homing_offset", "-300") == 0
    assert bus.servo(3).memory.get(sts.homing_offset) == -300
    capsys.readouterr()
    assert run(monkeypatch, "register", "write", *where, "max_voltage", "14V") == 0
    assert "nothing was written because the value is the same" in capsys.readouterr().out


def test_commands_that_ask_first_do_nothing_without_an_answer(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    port = ("--port", str(link))
    asking = (
        ("register", "write", *port, "--id", "3", "torque_enable", "1"),
        ("set-baud", "3", "500000", *port),
        ("factory-reset", "3", *port),
    )
    before = bytes(bus.servo(3).memory.read(0, 56))
    for arguments in asking:
        for answer in ("n\n", "\n", ""):
            assert run(monkeypatch, *arguments, answer=answer) == 1
            assert "continue?" in capsys.readouterr().err
    assert bytes(bus.servo(3).memory.read(0, 56)) == before


@pytest.mark.parametrize(
    ("value", "asks"), [("01", "will hold its position"), ("+1", "will hold its"), ("00", "will disable its torque")]
)
def test_the_torque_switch_asks_for_what_it_does(
    value: str,
    asks: str,
    bus: ServoLine[Any],
    link: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    where = ("--port", str(link), "--id", "3", "--baud", "1000000")
    assert run(monkeypatch, "register", "write", *where, "torque_enable", value, answer="n\n") == 1
    assert f"servo 3 {asks}" in capsys.readouterr().err


@pytest.mark.parametrize(("limit", "warns"), [(60, True), (499, True), (500, False), (999, False)])
def test_a_torque_limit_that_another_program_left_is_reported(
    limit: int,
    warns: bool,
    bus: ServoLine[Any],
    link: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    where = ("--port", str(link), "--id", "3", "--baud", "1000000")
    bus.servo(3).memory.put(sts.torque_limit, limit)
    assert run(monkeypatch, "register", "write", *where, "torque_enable", "1", "--yes") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert (f"its torque_limit is {limit}, but its max_torque is 1000, so the servo may not hold its" in said) == warns


@pytest.mark.parametrize(("value", "says"), [("2", "must be 0 (off) or 1 (on)"), ("on", "must be a number")])
def test_the_torque_switch_refuses_other_values_without_asking(
    value: str,
    says: str,
    bus: ServoLine[Any],
    link: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    where = ("--port", str(link), "--id", "3", "--baud", "1000000")
    assert run(monkeypatch, "register", "write", *where, "torque_enable", value, answer="y\n") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert says in said and "continue?" not in said


@pytest.mark.parametrize(("baud", "says"), [("0", "or equal to 1200"), ("99999999999", "or equal to 12000000")])
@pytest.mark.parametrize(
    "verb",
    [
        ("scan", "./none"),
        ("register", "read", "--port", "./none", "--id", "3", "id"),
        ("passport", "save", "none.yaml", "--port", "./none"),
    ],
    ids=" ".join,
)
def test_an_impossible_baud_rate_is_refused(
    verb: tuple[str, ...], baud: str, says: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, *verb, "--baud", baud) == 2
    assert says in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_in_the_middle_of_a_write_leaves_the_eeprom_locked(
    number: signal.Signals,
    times: int,
    bus: ServoLine[Any],
    link: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The EEPROM is locked even if more signals arrive in the meantime."""
    put, close, former = Eeprom._put, Eeprom.close, signal.getsignal(number)
    left = [times - 1]

    def signalled(memory: Eeprom, register: Register, value: int) -> None:
        assert bus.servo(3).memory.get(sts.lock) == 0
        os.kill(os.getpid(), number)
        put(memory, register, value)

    def again(memory: Eeprom) -> None:
        if left[0]:
            left[0] -= 1
            os.kill(os.getpid(), number)
        close(memory)

    monkeypatch.setattr(Eeprom, "_put", signalled)
    monkeypatch.setattr(Eeprom, "close", again)
    status = run(monkeypatch, "register", "write", "--port", str(link), "--id", "3", "max_temperature", "61")
    assert status == cli.INTERRUPTED
    assert "interrupted; the port is closed" in capsys.readouterr().err
    assert (bus.servo(3).memory.get(sts.lock), bus.servo(3).memory.get(sts.max_temperature)) == (1, 70)
    assert signal.getsignal(number) is former


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("verb", ["scan", "doctor"])
def test_a_signal_while_servos_are_read_restores_the_baud_rate(
    verb: str,
    number: signal.Signals,
    bus: ServoLine[Any],
    link: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rates: list[int] = []
    set_baud = SerialPort.set_baud

    def signalled(port: SerialPort, baud: int) -> None:
        set_baud(port, baud)
        rates.append(baud)
        if baud == 500_000:
            os.kill(os.getpid(), number)

    monkeypatch.setattr(SerialPort, "set_baud", signalled)
    bus.faults.silence(3)  # The doctor then searches for the servo at all rates.
    arguments = (str(link), "--baud", "1000000", "--baud", "500000") if verb == "scan" else ("--port", str(link))
    assert run(monkeypatch, verb, *arguments) == cli.INTERRUPTED
    assert "interrupted; the port is closed" in capsys.readouterr().err
    assert rates[-1] != 500_000


def test_set_baud_prints_how_to_undo_the_change_before_the_change(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise DriverError("servo 3 does not respond")

    monkeypatch.setattr(Eeprom, "write_unread", fails)
    assert run(monkeypatch, "set-baud", "3", "500000", "--port", str(link), "--yes") == 1
    said = capsys.readouterr().err.splitlines()
    undo = f"To undo this change, run: servoloop set-baud 3 1000000 --port {link}"
    assert said == [undo, "servoloop: servo 3 does not respond"]


@pytest.mark.parametrize(("baud", "torque"), [("500000", 1), ("123456", 0), ("1000000", 0)])
def test_set_baud_prints_no_command_to_undo_if_nothing_is_written(
    bus: ServoLine[Any],
    link: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    baud: str,
    torque: int,
) -> None:
    bus.servo(3).memory.put(sts.torque_enable, torque)
    before = bus.servo(3).memory.get(sts.baud_rate)
    run(monkeypatch, "set-baud", "3", baud, "--port", str(link), "--yes")
    assert "To undo" not in capsys.readouterr().err and bus.servo(3).memory.get(sts.baud_rate) == before


def test_an_eeprom_that_may_be_unlocked_is_reported(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(memory: Eeprom, register: Register, value: int) -> None:
        bus.faults.silence(3)
        raise EepromError(3, register, "is on its way")

    monkeypatch.setattr(Eeprom, "_put", lost)
    assert run(monkeypatch, "register", "write", "--port", str(link), "--id", "3", "max_temperature", "61") == 1
    said = capsys.readouterr().err
    assert "max_temperature (register 13) is on its way" in said and "the EEPROM may be left unlocked" in said


def test_mistakes_name_the_servo_and_the_solution(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    port = ("--port", str(link))
    for arguments, says in (
        (
            ("register", "write", *port, "--id", "3", "goal_position", "0"),
            "servo 3: goal_position cannot be written here",
        ),
        (("register", "read", *port, "--id", "3", "volts"), "sts3215 has no register volts"),
        (("set-id", "3", "4", *port), "servo 3: id (register 5) cannot be changed to 4: another servo has this ID"),
        (
            ("register", "read", *port, "--baud", "500000", "--id", "3", "id"),
            "no servo with ID 3 responds at 500000 baud",
        ),
        (("reboot", "3", "--port", "/dev/ttyACM77"), "/dev/ttyACM77 does not exist"),
        (("scan", str(link), "--ids", ""), "--ids must be IDs from 0 to 253, such as 1-7 or 1,2,5, not ''"),
    ):
        assert run(monkeypatch, *arguments) == 1
        assert says in " ".join(capsys.readouterr().err.split())


def test_scan_names_the_rates_if_no_servo_has_the_requested_rate(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "scan", str(link), "--ids", "1", "--baud", "115201") == 1
    assert "no supported servo has 115201 baud: use one of 9600, 19200" in " ".join(capsys.readouterr().out.split())


def test_the_command_that_disables_the_torque_names_the_port(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bus.servo(3).memory.put(sts.torque_enable, 1)
    where = ("--port", str(link), "--id", "3", "--baud", "1000000")
    assert run(monkeypatch, "register", "write", *where, "max_temperature", "60", answer="y\n") == 1
    command = f"servoloop register write --port {link} --id 3 torque_enable 0"
    assert command in " ".join(capsys.readouterr().err.split())


def test_scan_exits_with_1_if_a_servo_is_absent(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bus.faults.silence(2)
    assert run(monkeypatch, "scan", str(link), "--ids", "1-3", "--baud", "1000000", "--json") == 1
    report = json.loads(capsys.readouterr().out)
    assert ([one["servo_id"] for one in report["servos"]], report["absent"]) == ([1, 3], [2])
    assert run(monkeypatch, "scan", str(link), "--ids", "1-3", "--baud", "1000000") == 1
    assert "servo 2: does not respond" in " ".join(capsys.readouterr().out.split())


def test_scan_exits_with_1_if_the_models_of_the_arm_differ(
    bus: ServoLine[Any], link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bus.servo(2).memory.put(sts.model_number, sts.STS3250.number)
    assert run(monkeypatch, "scan", str(link), "--ids", "2", "--arm", "so101", "--baud", "1000000") == 1
    assert "servo 2 of the arm must be an sts3215_c001" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_dynamixels_on_a_pseudo_terminal(
    link: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(link, {1: x.XL430_W250, 4: x.XL330_M288}):
        began_s = time.monotonic()
        assert run(monkeypatch, "scan", str(link), "--baud", "1000000", "--json") == 0
        assert time.monotonic() - began_s < 15.0
        found = {one["servo_id"]: one["model"] for one in json.loads(capsys.readouterr().out)["servos"]}
        assert found == {1: "xl430-w250", 4: "xl330-m288"}
        assert run(monkeypatch, "register", "read", "--port", str(link), "--id", "4", "goal_current") == 0
        assert capsys.readouterr().out.startswith("goal_current ")


TOOLS = [
    *("ports", "scan", "setup", "calibrate", "doctor", "set-id", "set-baud", "factory-reset", "reboot"),
    *("register list", "register read", "register write", "passport save", "passport diff", "passport restore"),
    *("calibration import", "calibration export", "calibration show", "arms", "arms check", "bench bus", "bench arm"),
    *("hand", "fault"),
]


@pytest.mark.parametrize("verb", TOOLS)
def test_every_tool_has_help_with_an_example_and_json(
    verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["servoloop", *verb.split(), "--help"])
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    said = " ".join(capsys.readouterr().out.split())
    assert exit_.value.code == 0
    assert re.search(f"Example[^:]*: servoloop {verb}", said) and "--json" in said
