"""``servoloop up`` and ``Arm`` choose the devices of a stack in the same way."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import pytest

from drivers.driver_errors import DriverError
from servoloop.stack import emulator_process
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator_process import chosen_devices
from servoloop.stack.hardware import HardwareKind

FILES = read_arm_files(find_arm("so101"))


@pytest.fixture(autouse=True)
def emulator(monkeypatch: pytest.MonkeyPatch) -> None:
    """Serve a pseudo-terminal at a path, as an emulator would."""

    @contextmanager
    def served(files: object, signals: Callable[[], int]) -> Iterator[Mapping[str, str]]:
        yield {"": "virtual"}

    monkeypatch.setattr(emulator_process, "virtual_servos", served)


@pytest.mark.parametrize(
    ("kind", "ports", "devices"),
    [
        (None, {"": "/dev/ttyACM0"}, {"": "/dev/ttyACM0"}),
        (None, None, {"": "virtual"}),
        (HardwareKind.MOCK, None, {}),
    ],
    ids=["port", "virtual", "mock"],
)
def test_the_devices_are_the_ports_or_virtual_servos(
    kind: HardwareKind | None, ports: Mapping[str, str] | None, devices: Mapping[str, str]
) -> None:
    with chosen_devices(kind, ports, FILES) as found:
        assert found == devices


def test_a_port_without_servos_is_refused() -> None:
    with (
        pytest.raises(DriverError, match="no component uses servos"),
        chosen_devices(HardwareKind.MOCK, {"": "/dev/ttyACM0"}, FILES),
    ):
        pass
