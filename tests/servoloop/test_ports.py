"""Assignment of serial devices to buses."""

from pathlib import Path

import pytest

from drivers.driver_errors import DriverError
from servoloop.commands.shared.line_options import device_of
from servoloop.stack.devices import device_paths, parse_ports, port_options, world_feed
from sim_backend.scene.world_feed import WorldFeed, feed_path
from tests.complaint import complaint

TWO = ("arm", "hand")


@pytest.mark.parametrize("values", [[], ["virtual"]])
def test_without_a_port_the_servos_are_virtual(values: list[str]) -> None:
    assert parse_ports(values, [""]) is None
    assert parse_ports(values, TWO) is None


def test_the_path_of_a_single_bus_needs_no_name() -> None:
    assert parse_ports(["/dev/a=b"], [""]) == {"": "/dev/a=b"}
    assert parse_ports(["/dev/a"], ["arm"]) == parse_ports(["arm=/dev/a"], ["arm"]) == {"arm": "/dev/a"}


def test_several_buses_can_be_given_in_any_order() -> None:
    assert parse_ports(["hand=/dev/b", "arm=/dev/a"], TWO) == {"arm": "/dev/a", "hand": "/dev/b"}


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (["/dev/a"], "--port /dev/a does not specify a bus; bus arm has no --port; bus hand has no --port"),
        (["arm=/dev/a"], "bus hand has no --port. The robot file has the buses arm, hand: use --port arm=PATH --port"),
        (["arm=/dev/a", "foot=/dev/b"], "--port foot=/dev/b does not specify a bus; bus hand has no --port"),
        (["arm=/dev/a", "arm=/dev/b", "hand=/dev/c"], "--port arm= is given twice"),
        (["arm=/dev/a", "hand=/dev/a"], "two buses cannot share /dev/a"),
        (["arm=", "hand=/dev/a"], "--port arm= does not specify"),
        (["arm=/", "hand=/dev/a"], "--port arm=/ does not specify"),
    ],
)
def test_missing_unknown_and_repeated_buses_are_reported(values: list[str], says: str) -> None:
    with pytest.raises(DriverError) as caught:
        parse_ports(values, TWO)
    assert says in str(caught.value)


@pytest.mark.parametrize(("value", "bus"), [("", ""), (".", ""), ("/", ""), ("arm=", "arm"), ("", "arm")])
def test_a_port_without_a_device_is_refused(value: str, bus: str) -> None:
    with pytest.raises(DriverError, match="--port needs the path of a device"):
        parse_ports([value], [bus])


def test_several_buses_in_one_value_are_separated_by_commas() -> None:
    assert parse_ports(["hand=/dev/b,arm=/dev/a"], TWO) == {"arm": "/dev/a", "hand": "/dev/b"}
    assert parse_ports(["hand=/dev/b,c", "arm=/dev/a"], TWO) == {"arm": "/dev/a", "hand": "/dev/b,c"}


@pytest.mark.parametrize(("bus", "known"), [("", "has no name"), ("arm", "is named arm")])
def test_the_name_of_another_bus_is_refused_if_the_robot_has_one_bus(bus: str, known: str) -> None:
    with pytest.raises(DriverError, match=rf"names the bus foo, but the only bus {known}: use --port \./bus"):
        parse_ports(["foo=./bus"], [bus])


@pytest.mark.parametrize("bus", [None, "left"])
def test_a_command_for_one_bus_accepts_the_port_with_the_name_of_the_bus(bus: str | None) -> None:
    assert device_of("left=./bus.left", bus) == device_of("./bus.left", bus) == "./bus.left"
    assert device_of("/dev/a=b", bus) == "/dev/a=b"


def test_a_port_of_another_bus_is_refused() -> None:
    with pytest.raises(DriverError, match="is the port of the bus right, but --bus is left"):
        device_of("right=./bus.right", "left")


@pytest.mark.parametrize("form", [["--port", "left=L,right=R"], ["--port", "left=L", "--port", "right=R"]])
def test_teach_play_accepts_the_ports_of_several_buses_in_both_forms(
    form: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = complaint(capsys, monkeypatch, "teach", "play", "x", "--arm", "bimanual_so101", "--hands-free", *form)
    assert "there is no motion x" in said


def test_two_ports_for_one_bus_are_refused() -> None:
    with pytest.raises(DriverError, match="the robot has only one bus: pass only one --port"):
        parse_ports(["/dev/a", "/dev/b"], [""])


def test_the_paths_of_an_emulator_are_the_ports_of_a_stack(tmp_path: Path) -> None:
    link = tmp_path / "bus"
    assert device_paths(link, [""]) == {"": link}
    assert port_options(link, [""]) == ["--port", str(link)]
    assert device_paths(link, TWO) == {"arm": tmp_path / "bus.arm", "hand": tmp_path / "bus.hand"}
    options = port_options(link, TWO)
    assert parse_ports(options[1::2], TWO) == {name: str(path) for name, path in device_paths(link, TWO).items()}


@pytest.mark.parametrize("buses", [("",), TWO])
def test_the_world_of_an_emulator_is_found_from_its_ports(tmp_path: Path, buses: tuple[str, ...]) -> None:
    link = tmp_path / "bus"
    devices = {name: str(path) for name, path in device_paths(link, buses).items()}
    assert world_feed(devices) is None
    with WorldFeed(feed_path(link)):
        assert world_feed(devices) == feed_path(link)
