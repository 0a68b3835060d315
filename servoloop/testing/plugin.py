"""Pytest plugin with the fixtures ``virtual_arm``, ``virtual_bus`` and ``ros_stack``, and their markers.

Pytest loads this plugin in every environment in which servoloop is installed. Therefore the plugin imports nothing
until a fixture is used.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from servoloop.testing.arm import VirtualArm
    from servoloop.testing.processes import RosStack, VirtualBusProcess

MARKERS = (
    "virtual_arm(arm, robot=None, urdf=None, controllers=None, backlash_deg=1.0): choose the arm of the fixtures",
    "faults('silent id=3 at=1s for=2s', ...): inject faults; times count from the activation of the arm; see "
    "`servoloop fault --list`",
    "random_faults(count=3, within_s=5.0, kinds=None): inject random faults drawn from `seed`",
    "seeds(count, first=0): run the test once per seed, each with a different arm and different random faults",
    "invariants(also=(), without=(), examined=()): add your own invariant classes, omit invariants by name, and "
    "list invariants whose condition must occur in each test",
    "rtf(factor): run the ROS stack at this multiple of real time, or 'max'; the default is real time",
)

SUPPORTED = {
    "virtual_arm": ("faults", "random_faults", "seeds", "invariants", "backlash_deg"),
    "virtual_bus": ("faults", "seeds", "backlash_deg"),
    "ros_stack": ("rtf",),
}
"""Markers that each fixture supports, in addition to ``virtual_arm``, and the argument ``backlash_deg`` of this
marker."""

INVARIANTS = ("also", "without", "examined")
"""Arguments of the ``invariants`` marker."""

ARM: pytest.StashKey["VirtualArm"] = pytest.StashKey()
"""Virtual arm of a test."""


def pytest_configure(config: pytest.Config) -> None:
    """Register the markers."""
    for line in MARKERS:
        config.addinivalue_line("markers", line)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run each test that has the ``seeds`` marker once per seed."""
    marker = metafunc.definition.get_closest_marker("seeds")
    if marker is not None:
        count, first = _seeds(marker)
        metafunc.fixturenames.append("seed")
        metafunc.parametrize("seed", range(first, first + count))


def _seeds(marker: pytest.Mark) -> tuple[int, int]:
    """Return the number of seeds and the first seed. Raises UsageError, because a test without seeds never runs."""
    values = {**dict(zip(("count", "first"), marker.args, strict=False)), **marker.kwargs}
    if len(marker.args) > 2 or not {"count"} <= values.keys() <= {"count", "first"}:
        raise pytest.UsageError(
            "seeds needs a count and optionally a first seed: write seeds(20) or seeds(20, first=5)"
        )
    count, first = values["count"], values.get("first", 0)
    if type(count) is not int or count < 1:
        raise pytest.UsageError(f"seeds needs a count of at least 1, not {count!r}: write seeds(20)")
    if type(first) is not int or first < 0:
        raise pytest.UsageError(f"seeds needs a first seed of at least 0, not {first!r}: write seeds(20, first=5)")
    return count, first


@pytest.fixture
def seed() -> int | None:
    """Return the seed of the arm and of its faults, or None for the nominal arm."""
    return None


@pytest.fixture
def virtual_arm(request: pytest.FixtureRequest, seed: int | None) -> Iterator["VirtualArm"]:
    """Yield an inactive virtual arm in simulated time. The test fails if an invariant is violated."""
    _require_simulation("virtual_arm")
    _require_supported(request)
    from servoloop.testing.arm import VirtualArm

    node = request.node
    arm = VirtualArm(_files(node), seed, **_arm(node), **_invariants(node))
    arm.plan(*_texts(node))
    if (marker := node.get_closest_marker("random_faults")) is not None:
        arm.draw(*marker.args, **marker.kwargs)
    node.stash[ARM] = arm
    yield arm
    arm.end()  # If the test failed, its arm has not been shut down yet. Other tests have.


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Iterator[None]:
    """Shut down the virtual arm at the end of a test, and fail the test if an invariant was violated."""
    result = yield
    arm = pyfuncitem.stash.get(ARM, None)
    if arm is not None and (report := arm.end()):
        pytest.fail(f"{report}\nto reproduce: pytest '{pyfuncitem.nodeid}'", pytrace=False)
    return result


@pytest.fixture
def virtual_bus(request: pytest.FixtureRequest, seed: int | None, tmp_path: Any) -> Iterator["VirtualBusProcess"]:
    """Yield the arm's servos on the pseudo-terminal ``virtual_bus.port``, in a separate process."""
    _require_simulation("virtual_bus")
    _require_supported(request)
    from servoloop.testing.processes import VirtualBusProcess

    with VirtualBusProcess(_files(request.node), tmp_path, seed, **_arm(request.node)).running() as bus:
        for text in _texts(request.node):
            bus.fault(text)
        yield bus


@pytest.fixture
def ros_stack(request: pytest.FixtureRequest, tmp_path: Any) -> Iterator["RosStack"]:
    """Yield a running ``servoloop up`` with virtual servos, ready for goals, in a ROS domain that no other test run
    uses."""
    pytest.importorskip("rclpy", reason="the ROS stack needs rclpy: pip install servoloop[ros], or source ROS 2 Jazzy")
    _require_simulation("ros_stack")
    _require_supported(request)
    from servoloop.testing.processes import RosStack

    with RosStack(_files(request.node), tmp_path, _rtf(request.node)).running() as stack:
        yield stack


def _require_simulation(fixture: str) -> None:
    from servoloop.extras import missing_extras

    if sentence := missing_extras(f"the fixture {fixture}", "sim"):
        pytest.fail(sentence, pytrace=False)


def _require_supported(request: pytest.FixtureRequest) -> None:
    """Require that a fixture of the test supports each marker of the test. Raises UsageError."""
    node, fixtures = request.node, [name for name in SUPPORTED if name in (*request.fixturenames, request.fixturename)]
    used = [name for names in SUPPORTED.values() for name in names if node.get_closest_marker(name) is not None]
    for name in (*used, *_arm(node)):
        if not any(name in SUPPORTED[fixture] for fixture in fixtures):
            others = " or ".join(fixture for fixture, names in SUPPORTED.items() if name in names)
            raise pytest.UsageError(
                f"`{name}` has no effect on {' and '.join(fixtures)}: remove `{name}`, or use the fixture {others}"
            )


def _files(node: pytest.Item) -> dict[str, Any]:
    """Return the arm's files from the marker, keyed by the option of ``servoloop up``."""
    options = _marker_options(node)
    return {name: options[name] for name in ("arm", "urdf", "robot", "controllers") if options.get(name) is not None}


def _arm(node: pytest.Item) -> dict[str, Any]:
    options = _marker_options(node)
    return {"backlash_deg": options["backlash_deg"]} if "backlash_deg" in options else {}


def _marker_options(node: pytest.Item) -> dict[str, Any]:
    marker = node.get_closest_marker("virtual_arm")
    if marker is None:
        return {}
    names = ("arm", "urdf", "robot", "controllers", "backlash_deg")
    if unknown := [*map(repr, marker.args[1:]), *(name for name in marker.kwargs if name not in names)]:
        raise pytest.UsageError(f"virtual_arm accepts the arm and {', '.join(names[1:])}, not {', '.join(unknown)}")
    return {**dict(zip(names, marker.args, strict=False)), **marker.kwargs}


def _texts(node: pytest.Item) -> list[str]:
    """Return the faults of all ``faults`` markers of a test."""
    texts: list[str] = []
    for marker in reversed(list(node.iter_markers("faults"))):
        if marker.kwargs:
            raise pytest.UsageError(
                f"faults accepts only strings such as 'silent id=3', not {', '.join(marker.kwargs)}"
            )
        texts += marker.args
    return texts


def _rtf(node: pytest.Item) -> "float | str | None":
    """Return the factor of the ``rtf`` marker, or None for real time."""
    marker = node.get_closest_marker("rtf")
    if marker is None:
        return None
    factors: list[float | str] = [*marker.args, *marker.kwargs.values()]
    if len(factors) != 1 or marker.kwargs.keys() - {"factor"}:
        raise pytest.UsageError("rtf needs one factor of real time, or 'max': write rtf(2.0) or rtf('max')")
    return factors[0]


def _invariants(node: pytest.Item) -> dict[str, Any]:
    """Return the combined arguments of all ``invariants`` markers of a test, keyed by name."""
    chosen: dict[str, Any] = dict.fromkeys(INVARIANTS, ())
    for marker in node.iter_markers("invariants"):
        if unknown := [*map(repr, marker.args), *(name for name in marker.kwargs if name not in INVARIANTS)]:
            lists = f"{', '.join(INVARIANTS[:-1])} and {INVARIANTS[-1]}"
            raise pytest.UsageError(f"invariants accepts the lists {lists}, not {', '.join(unknown)}")
        for name, entries in marker.kwargs.items():
            if isinstance(entries, str):
                raise pytest.UsageError(f"invariants({name}={entries!r}) must be a list: [{entries!r}]")
            chosen[name] += tuple(entries)
    return chosen
