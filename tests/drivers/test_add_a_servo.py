"""Follow docs/add-a-servo.md in a copy of the package and test the result."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import drivers.clock
import drivers.port.serial_port
from drivers.bus.bus import Bus
from drivers.servos import catalog, dynamixel, scs
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.pages import codes

ROOT = Path(__file__).parents[2]
SOURCES = Path(drivers.__file__).parents[1]
"""Folder that contains the packages: the checkout, or the place where they are installed."""
PAGE = "add-a-servo.md"
BLOCKS = codes(PAGE, "python")
PLACED = [block for block in BLOCKS if block.startswith("# drivers/")]
RUNNABLE = [block for block in BLOCKS if block not in PLACED]
ADDED = ("sts3046", "scs20", "my-x430", "my-mx28")
"""Models that the file on the page defines."""
SCX = "scx30"
"""Model of the series that the page adds."""
TABLE_TESTS = (
    "tests/drivers/test_every_model.py",
    "tests/drivers/test_feetech_tables.py",
    "tests/drivers/test_dynamixel1_tables.py",
    "tests/drivers/test_dynamixel_tables.py",
    "tests/drivers/test_dynamixel_models.py",
    "tests/sim_backend/test_dynamixel1_servo.py",
    "tests/sim_backend/test_scs_servo.py",
)


def placed(block: str, package: Path) -> None:
    """Insert a code block of the page into the file that its first line names."""
    head, code = block.split("\n", 1)
    file = package / head.removeprefix("# ").partition(",")[0]
    if above := re.fullmatch(r".*, above (\w+)", head):
        text, count = re.subn(rf"^(?={above[1]}: Final)", lambda _: code + "\n", file.read_text(), flags=re.MULTILINE)
        assert count == 1, head
    else:
        text = in_the_place_of_its_own(code, (file.parent / "scs.py").read_text())
    file.write_text(text)


def in_the_place_of_its_own(code: str, text: str) -> str:
    """Return a copy of a table with these registers and models instead of its own."""
    registers, models = code.split("\n\n", 1)
    for line in registers.splitlines():
        name = line.partition(" ")[0]
        text, count = re.subn(rf"^{name} = Register.*$", lambda _, line=line: line, text, flags=re.MULTILINE)
        assert count == 1, name
    before, _, rest = text.partition("SCS15 = ServoModel(")
    return before + models + "\n" + rest[rest.index("MODELS: Final") :]


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Create a copy of the package and follow the steps of the page in it."""
    copy = tmp_path_factory.mktemp("package")
    for folder in ("drivers", "sim_backend"):
        shutil.copytree(SOURCES / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in ("tests/drivers", "tests/sim_backend"):
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for name in (
        "conftest.py",
        "distribution.py",
        "marked.py",
        "pages.py",
        "ros_domain.py",
        "tiers.py",
        "long_tests.txt",
    ):
        shutil.copy(ROOT / "tests" / name, copy / "tests")
    shutil.copy(ROOT / "pyproject.toml", copy)
    for block in PLACED:
        placed(block, copy)
    shutil.copytree(SOURCES / "hal", copy / "hal", ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "servo_models.yaml").write_text(codes(PAGE, "yaml")[0])
    return copy


def run(package: Path, *arguments: str) -> str:
    """Run code in the copy and return its output."""
    done = subprocess.run(
        (sys.executable, *arguments),
        cwd=package,
        env={**os.environ, "PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
        check=False,
        timeout=120.0,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_servo_of_the_series_that_the_page_adds_is_identified_read_and_moved(package: Path) -> None:
    output = run(package, "-m", "pytest", "-q", "-rA", "-p", "no:cacheprovider", *TABLE_TESTS)
    for test in (
        "the_model_is_found_by_its_number",
        "the_servo_is_at_rest_without_alarms_and_then_reaches_its_goal",
    ):
        assert f"PASSED tests/drivers/test_every_model.py::test_{test}[{SCX}]" in output


@pytest.mark.slow
@pytest.mark.runs(f"{PAGE} python 4")
def test_the_example_on_the_page_runs_after_the_addition(package: Path) -> None:
    *_, trial = RUNNABLE
    output = run(package, "-c", trial)
    assert re.match(r"ServoState\(position_counts=102[345], ", output), output


@pytest.mark.runs(f"{PAGE} yaml 1", f"{PAGE} python 2", f"{PAGE} python 3")
def test_every_added_model_is_complete_and_has_its_series_protocol(package: Path) -> None:
    asked = (
        "from pathlib import Path\n"
        "from drivers.servos.catalog import MODELS, series_of\n"
        "from hal.robot_file.servo_models import load_servo_models\n"
        "load_servo_models(Path())\n"
        f"for name in {(*ADDED, SCX)!r}:\n"
        "    print(name, series_of(MODELS[name]).protocol.name, MODELS[name].last_count, sep=': ')"
    )
    assert run(package, "-c", asked).splitlines() == [
        "sts3046: Feetech STS: 4095",
        "scs20: Feetech SCS: 1023",
        "my-x430: Dynamixel protocol 2.0: 4095",
        "my-mx28: Dynamixel protocol 1.0: 4095",
        "scx30: Feetech SCX: 1023",
    ]


def test_a_model_without_a_series_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimulatedClock(0.0)
    port = VirtualPort(VirtualBus.of(BenchPlant((1,)), scs.SCS15), clock)
    monkeypatch.setattr(catalog, "SERIES", dynamixel.SERIES)
    with pytest.raises(ValueError, match="scs15 is not a supported servo model"):
        Bus(port, clock, {1: scs.SCS15})


@pytest.mark.runs(f"{PAGE} python 1")
def test_the_two_bytes_are_the_model_number(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimulatedClock(0.0)
    port = VirtualPort(VirtualBus.of(BenchPlant((1,)), scs.SCS0009), clock)
    monkeypatch.setattr(drivers.port.serial_port, "SerialPort", lambda device, baud: port)
    monkeypatch.setattr(drivers.clock, "MonotonicClock", lambda: clock)
    names: dict[str, object] = {}
    exec(compile(RUNNABLE[0], "add-a-servo.md", "exec"), names)
    assert names["number_bytes"] == (5, 4)
