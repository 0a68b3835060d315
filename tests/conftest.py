"""Use the same random examples in every run, repeat tests that failed because of a stall, and use all cores."""

import gc
import signal
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from planning.collision import warm_up
from sim_backend.compile_ahead import compile_ahead
from tests.distribution import ComputingAside, in_real_time, stand_back
from tests.marked import remember
from tests.pages import require_taken
from tests.ros_domain import ros_domain
from tests.tiers import has_long_tests, mark_long, sample

__all__ = ["ros_domain"]  # one fixture for all folders, because a fixture for each folder would end too early

MOST_CHARACTERS = 2000
"""Number of characters at the end of an error that are shown for a repeated test."""
once_more = pytest.mark.flaky(reruns=1)
"""Marker of real-time tests, which may fail if the machine stalls for a moment. The summary lists repeated tests."""
ONLY = {"slow": ("slow", "workspace", "installed", "share"), "soak": ("soak",)}
"""Every file with a test that has this marker contains at least one of these words. tests/launch/conftest.py adds
markers according to fixtures."""
LONG_FILES = (
    *("tests/drivers/test_bus_", "tests/stack/", "tests/sim_backend/test_world_"),
    *("tests/commissioning/test_calibrate_", "tests/commissioning/test_doctor_", "tests/arms/"),
    *("tests/servoloop/test_campaign", "tests/servoloop/test_simulate", "tests/servoloop/test_broken_layers"),
    "tests/docs/test_pictures",
)

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    """Compile the simulation and the planning code before the workers start, because workers that compile at the same
    time damage the cache."""
    _hear_interrupts()
    if not hasattr(config, "workerinput"):
        compile_ahead()
        warm_up()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Exclude the collected tests from garbage collection. There are twelve thousand test objects, and nearly all of
    them exist until the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def _hear_interrupts() -> None:
    """Restore the handlers of signals that a shell ignores in background programs and under nohup. Pytest and the
    tested programs need these signals."""
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)


@pytest.hookimpl(optionalhook=True)
def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Show the error of each repeated test, because a test that passes the second time shows none."""
    for report in terminalreporter.stats.get("rerun", ()):
        terminalreporter.write_line(f"repeated: {report.nodeid}")
        terminalreporter.write_line(report.longreprtext[-MOST_CHARACTERS:])


@pytest.hookimpl(optionalhook=True)  # `make mutants` runs without xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Run tests over ROS at the same time as other tests if files are distributed to workers."""
    if config.getoption("dist") != "loadfile":
        return None
    return ComputingAside(config, log)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skip files without a selected test, because importing all files takes ten seconds."""
    if not collection_path.match("test_*.py"):
        return None
    expression = config.option.markexpr
    if "real_time" in expression:
        selected = "not real_time" not in expression
        return in_real_time(collection_path.relative_to(config.rootpath).as_posix()) != selected or None
    markers = expression.split(" or ")
    if not ONLY.keys() >= {*markers}:
        return None
    if "slow" in markers and has_long_tests(collection_path):
        return None
    return not any(_has_a_word_of(marker, collection_path) for marker in markers) or None


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option with which CI runs only a part of the slow tests."""
    parser.addoption("--sample", action="store_true", help="run the first of the selected tests of each folder")


def _has_a_word_of(marker: str, path: Path) -> bool:
    return any(word in path.read_text() for word in ONLY[marker])


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run real-time tests first, then files with long computations, and then short files, which balance the load."""
    marked = {(mark.name, item.path) for item in items for mark in item.iter_markers() if mark.name in ONLY}
    if passed_over := [str(path) for marker, path in sorted(marked) if not _has_a_word_of(marker, path)]:
        raise pytest.UsageError(f"marked in another file, so make test-slow would skip it: {passed_over}")
    mark_long(items)
    remember(config, items)
    items.sort(key=lambda item: (not in_real_time(item.nodeid), not item.nodeid.startswith(LONG_FILES)))
    for item in items:
        if in_real_time(item.nodeid):
            item.add_marker(once_more)
            item.add_marker(pytest.mark.real_time)


@pytest.hookimpl(specname="pytest_collection_modifyitems", trylast=True)
def pytest_sample_items(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect tests as ``--sample`` requires, after the selection by markers."""
    if config.getoption("sample"):
        kept = sample(items)
        config.hook.pytest_deselected(items=[item for item in items if item not in set(kept)])
        items[:] = kept


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Lower the priority of a worker that runs computations, in favor of real-time tests."""
    if hasattr(item.config, "workerinput") and not in_real_time(item.nodeid):
        stand_back()


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Generator[None, object, object]:
    """Check that a test has read the documentation's code blocks that are listed in its marker."""
    result = yield
    require_taken(pyfuncitem.iter_markers("runs"))
    return result
