"""The pytest plugin: fixtures ``virtual_arm``, ``virtual_bus`` and ``ros_stack``, and the markers that say which arm.

It is loaded in every pytest run of an environment that has servoloop: it imports nothing before a fixture is used.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from servoloop.testing.arm import VirtualArm
    from servoloop.testing.processes import RosStack, VirtualBus

MARKERS = (
    "virtual_arm(arm, robot=None, urdf=None, controllers=None, backlash_deg=1.0): which arm servoloop's fixtures are",
    "faults('silent id=3 at=1s for=2s', ...): what goes wrong, since the arm is up, see `servoloop fault --list`",
    "random_faults(count=3, within_s=5.0, kinds=None): as many faults as that, drawn from `seed`",
    "seeds(count, first=0): once for each seed, which is `seed`: an arm of its own, and faults of its own",
    "invariants(also=(), without=(), examined=()): your own classes beside servoloop's, names of servoloop's to leave "
    "out, and names of those that must examine something in each test",
    "rtf(factor): so many times as fast as real time, or 'max'; without it the ROS stack is in real time",
)

INVARIANTS = ("also", "without", "examined")
"""The lists that the marker ``invariants`` takes."""

ARM: pytest.StashKey["VirtualArm"] = pytest.StashKey()
"""A test's virtual arm."""


def pytest_configure(config: pytest.Config) -> None:
    """Make the markers known."""
    for line in MARKERS:
        config.addinivalue_line("markers", line)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test with the marker ``seeds`` once for each."""
    marker = metafunc.definition.get_closest_marker("seeds")
    if marker is not None:
        count, first = _seeds(*marker.args, **marker.kwargs)
        metafunc.fixturenames.append("seed")
        metafunc.parametrize("seed", range(first, first + count))


def _seeds(count: int, first: int = 0) -> tuple[int, int]:
    return count, first


@pytest.fixture
def seed() -> int | None:
    """The seed of the arm and of its faults; None: the nominal arm."""
    return None


@pytest.fixture
def virtual_arm(request: pytest.FixtureRequest, seed: int | None) -> Iterator["VirtualArm"]:
    """A virtual arm on simulated time, not yet up. At its end the program ends, and all invariants must have held."""
    from servoloop.testing.arm import VirtualArm

    node = request.node
    arm = VirtualArm(_files(node), seed, **_arm(node), **_invariants(node))
    arm.plan(*_texts(node))
    if (marker := node.get_closest_marker("random_faults")) is not None:
        arm.draw(*marker.args, **marker.kwargs)
    node.stash[ARM] = arm
    yield arm
    arm.end()  # has been, where the test came to its end


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Iterator[None]:
    """A test on a virtual arm is over when the program has ended, and it fails if an invariant is violated."""
    result = yield
    arm = pyfuncitem.stash.get(ARM, None)
    if arm is not None and (report := arm.end()):
        pytest.fail(f"{report}\nto see it again: pytest '{pyfuncitem.nodeid}'", pytrace=False)
    return result


@pytest.fixture
def virtual_bus(request: pytest.FixtureRequest, seed: int | None, tmp_path: Any) -> Iterator["VirtualBus"]:
    """The arm's servos on a pseudo-terminal in a process of their own: ``virtual_bus.port`` is a serial port."""
    from servoloop.testing.processes import VirtualBus

    with VirtualBus(_files(request.node), tmp_path, seed, **_arm(request.node)).running() as bus:
        for text in _texts(request.node):
            bus.fault(text)
        yield bus


@pytest.fixture
def ros_stack(request: pytest.FixtureRequest, tmp_path: Any) -> Iterator["RosStack"]:
    """``servoloop up`` with virtual servos in a ROS domain that no other test run has, ready for goals."""
    pytest.importorskip("rclpy", reason="the ROS stack needs rclpy: pip install servoloop[ros], or source ROS 2 Jazzy")
    from servoloop.testing.processes import RosStack

    marker = request.node.get_closest_marker("rtf")
    with RosStack(_files(request.node), tmp_path, *(marker.args if marker else ())).running() as stack:
        yield stack


def _files(node: pytest.Item) -> dict[str, Any]:
    """What the marker says of the arm's files, by the option of ``servoloop up``."""
    said = _said(node)
    return {name: said[name] for name in ("arm", "urdf", "robot", "controllers") if said.get(name) is not None}


def _arm(node: pytest.Item) -> dict[str, Any]:
    said = _said(node)
    return {"backlash_deg": said["backlash_deg"]} if "backlash_deg" in said else {}


def _said(node: pytest.Item) -> dict[str, Any]:
    marker = node.get_closest_marker("virtual_arm")
    if marker is None:
        return {}
    names = ("arm", "urdf", "robot", "controllers", "backlash_deg")
    unknown = [name for name in marker.kwargs if name not in names]
    if unknown or len(marker.args) > 1:
        raise pytest.UsageError(f"virtual_arm takes the arm and {', '.join(names[1:])}, not {', '.join(unknown)}")
    return {**dict(zip(names, marker.args, strict=False)), **marker.kwargs}


def _texts(node: pytest.Item) -> list[str]:
    return [text for marker in reversed(list(node.iter_markers("faults"))) for text in marker.args]


def _invariants(node: pytest.Item) -> dict[str, Any]:
    """The lists of all markers ``invariants`` of a test, by name."""
    chosen: dict[str, Any] = dict.fromkeys(INVARIANTS, ())
    for marker in node.iter_markers("invariants"):
        if unknown := [*map(repr, marker.args), *(name for name in marker.kwargs if name not in INVARIANTS)]:
            lists = f"{', '.join(INVARIANTS[:-1])} and {INVARIANTS[-1]}"
            raise pytest.UsageError(f"invariants takes the lists {lists}, not {', '.join(unknown)}")
        for name, entries in marker.kwargs.items():
            if isinstance(entries, str):
                raise pytest.UsageError(f"invariants({name}={entries!r}): write a list, [{entries!r}]")
            chosen[name] += tuple(entries)
    return chosen
