"""Test the controller of docs/write-a-controller.md in the controller manager, installed as a user's package."""

import sys
import tomllib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from controller.interface import ControllerContext
from controller.loop import ControlLoop
from controller.manager.client import ManagerClient
from controller.manager.controllers_file import load_controllers_file
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from controller.manager.plugins import controller_types, look_for_plugins_again
from controller.manager.settings import ManagerSettings
from controller.manager.switch import SwitchRequest
from controller.manager_errors import ControllersFileError, ManagerError, SwitchError
from hal.components.component_set import ComponentSet
from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from hal.robot_description.description import parse_urdf
from hal.types import JointLimits
from servoloop.stack.shipped_files import URDF
from sim_backend.clock import SimulatedClock
from tests.controller.bench import PERIOD_S, Bench
from tests.pages import code, named

LIMIT = JointLimits(-1.0, 1.0, 4.0, 12.0, 120.0)
HAND = """
controller_manager:
  ros__parameters: {hand: {type: forward_command_controller/ForwardCommandController}}
hand: {ros__parameters: {joints: [hand_right_joint], interface_name: position}}
"""
PAGE = "write-a-controller.md"


def block(language: str) -> str:
    """Return the code of the document that is in a given language."""
    return code(PAGE, language)


def install(folder: Path, module: str, source: str, entry_points: str) -> None:
    """Install a module with its entry points, as pip does."""
    (folder / f"{module}.py").write_text(source)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[servoloop.controllers]\n{entry_points}\n")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Create a folder at the end of Python's module search path, as pip does. Packages in this folder are no longer
    found after the test.

    Python keeps imported modules, so the module of each test needs a name of its own.
    """
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    yield tmp_path
    monkeypatch.undo()
    look_for_plugins_again()


def made(path: Path, settings: str) -> tuple[ControlLoop, ControllerManager, ManagerClient]:
    """A loop for the joints of the default arm, with the controllers of a file."""
    path.write_text(settings)
    description = parse_urdf(URDF.read_text())
    component = description.components[0]
    limits = dict.fromkeys(component.joints, LIMIT)
    clock = SimulatedClock(10.0)
    hardware = MockHardware(component.name, component.joints, clock, command_interfaces=component.commands)
    components = ComponentSet([hardware], clock)
    manager = ControllerManager(components, limits)
    factory = Factory(
        load_controllers_file(path, {}, component),
        ControllerContext(description, component, limits, manager.cycle.settled),
    )
    factory.fill(manager)
    loop = ControlLoop(components, manager, limits, clock, PERIOD_S)
    hardware.configure()
    loop.activate()
    return loop, manager, ManagerClient(loop, factory)


def cycles(loop: ControlLoop, count: int, joint: str = "joint6") -> list[float]:
    """Run cycles and return the commands of a joint."""
    told = []
    for _ in range(count):
        loop.clock.sleep_until(loop.clock.now() + PERIOD_S)
        loop.step()
        told.append(float(loop.command[loop.hardware.joints.index(joint)]))
    return told


@pytest.mark.runs(*named(PAGE, "python", "toml", "yaml"))
def test_the_documented_controller_runs_in_the_manager(site: Path) -> None:
    ((kind, place),) = tomllib.loads(block("toml"))["project"]["entry-points"]["servoloop.controllers"].items()
    install(site, "joint_wave", block("python"), f"{kind} = {place}")
    look_for_plugins_again()
    assert "joint_wave/Wave" in controller_types()
    loop, manager, manager_client = made(site / "controllers.yaml", block("yaml"))
    assert manager.registry.state("wave") is LifecycleState.ACTIVE
    assert dict(manager.registry.claimed) == {"joint6/position": "wave"}
    told = cycles(loop, 80)
    expected = 0.2 * np.sin(2.0 * np.pi * PERIOD_S * np.arange(1, 81) / 4.0)
    np.testing.assert_allclose(told, expected, atol=1e-12)
    manager_client.change("wave", manager.registry.controllers["wave"].parameters.model_copy(update={"amplitude": 0.0}))
    assert cycles(loop, 1) == [pytest.approx(0.0, abs=1e-12)]


def test_a_plugin_that_fails_during_a_motion_is_deactivated(site: Path) -> None:
    broken = block("python").replace(
        "self.elapsed_s += period_s", "self.elapsed_s += 1 / (self.elapsed_s < 0.3) * period_s"
    )
    install(site, "failing_wave", broken, "joint_wave/Wave = failing_wave:Wave")
    look_for_plugins_again()
    loop, manager, _ = made(site / "controllers.yaml", block("yaml"))
    told = cycles(loop, 40)
    assert manager.registry.state("wave") is LifecycleState.INACTIVE
    assert 0.0 < told[5] < told[6] <= told[-1] == told[-2]


@pytest.mark.parametrize(
    ("module", "source", "why"),
    [
        ("importing_wave", "import no_such_module", "No module named 'no_such_module'"),
        ("empty_wave", "x = 1", "has no attribute 'Wave'"),
    ],
)
def test_a_broken_plugin_is_reported_and_does_not_affect_others(site: Path, module: str, source: str, why: str) -> None:
    install(site, module, source, f"joint_wave/Wave = {module}:Wave")
    look_for_plugins_again()
    assert "joint_wave/Wave" not in controller_types() and len(controller_types()) > 3
    expected = rf"the controller joint_wave/Wave \({module}:Wave\) cannot be loaded: .*{why}"
    with pytest.raises(ControllersFileError, match=expected):
        made(site / "controllers.yaml", block("yaml"))


def test_a_plugin_named_like_a_standard_module_is_reported_with_the_remedy(site: Path) -> None:
    install(site, "wave", block("python"), "joint_wave/Wave = wave:Wave")
    look_for_plugins_again()
    with pytest.raises(ControllersFileError, match=r"Python imports its own module wave instead: rename wave\.py"):
        made(site / "controllers.yaml", block("yaml"))


def test_a_plugin_installed_later_is_found_after_a_reload(site: Path) -> None:
    loop, manager, manager_client = made(site / "controllers.yaml", HAND)
    install(site, "later_wave", block("python"), "joint_wave/Wave = later_wave:Wave")
    assert "joint_wave/Wave" not in manager_client.controller_types()
    refused, forced = manager_client.reload(force=False), manager_client.reload(force=True)
    cycles(loop, 1)
    with pytest.raises(ManagerError, match="hand cannot be unloaded while active: deactivate first, or use force"):
        refused.result()
    forced.result()
    assert (dict(manager.registry.loaded), "joint_wave/Wave" in manager_client.controller_types()) == ({}, True)
    extra = site / "wave.yaml"
    extra.write_text("wave: {ros__parameters: {joint: joint2}}")
    load = partial(manager_client.load, "wave", ManagerSettings("joint_wave/Wave", (extra,)))
    for ask in (load, partial(manager_client.configure, "wave")):
        request = ask()
        cycles(loop, 1)
        request.result()
    assert manager.registry.state("wave") is LifecycleState.INACTIVE


# Requests from other threads


def test_a_switch_after_its_timeout_is_not_done() -> None:
    bench = Bench().up()
    manager_client = ManagerClient(bench.loop, None)  # type: ignore[arg-type]
    late, soon = (
        manager_client.switch(SwitchRequest((), ("arm",)), 0.04),
        manager_client.switch(SwitchRequest((), ("hand",))),
    )
    assert not late.done and not soon.done
    bench.cycle()
    with pytest.raises(
        SwitchError, match=r"Switch controller timed out after 0\.040000 seconds! Nothing was switched\."
    ):
        late.result()
    assert soon.result() == "Successfully switched controllers!\nDeactivated controllers: [ hand ]"
    assert bench.manager.registry.state("arm") is LifecycleState.ACTIVE


@pytest.mark.parametrize(
    ("name", "text"),
    [
        *((name, "is not a valid controller name: use letters, digits and _") for name in ("spare-arm", "2nd", "a/b")),
        ("bräter", "is not a valid controller name"),
        ("robot_state_publisher", "is the name of a node of the stack itself: rename the controller"),
    ],
)
def test_an_invalid_node_name_is_rejected(name: str, text: str) -> None:
    manager_client = ManagerClient(Bench().loop, None)  # type: ignore[arg-type]
    with pytest.raises(ManagerError, match=f"^{name} {text}"):
        manager_client.load(name, ManagerSettings("joint_wave/Wave"))
