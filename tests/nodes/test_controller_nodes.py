"""A controller whose node fails does not delay the clients of other controllers."""

from collections.abc import Callable
from typing import Any, cast

import pytest

pytest.importorskip("rclpy")

from controller.manager.controller_spec import ControllerSpec
from controller.manager.switch import Loaded
from nodes.controllers import controller_nodes
from nodes.controllers.controller_nodes import ControllerNodes
from nodes.stack_nodes import StackNodes
from tests.controller.bench import Bench


class FakeNode:
    """Fake controller node. The name of the controller selects the operation that fails."""

    def __init__(self, spec: ControllerSpec, *_: object) -> None:
        if spec.name == "unmade":
            raise RuntimeError("no node of that name")
        self.name, self.node, self.controller = spec.name, self, None

    def belongs_to(self, entry: Loaded | None) -> bool:
        return entry is not None

    def last_cycles_are_over(self) -> bool:
        return True

    def set_controller(self, controller: Any) -> None:
        if self.name == "unset" and controller is not None:
            raise RuntimeError("no interface")
        self.controller = controller

    def publish_transition(self, transition: object) -> None:
        pass

    def destroy(self) -> None:
        if self.name == "undestroyed":
            raise RuntimeError("it stays")


class FakeExecutor:
    """Fake executor that accepts every node."""

    add_node = remove_node = staticmethod(lambda node: None)


def nodes_of(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> ControllerNodes:
    monkeypatch.setattr(controller_nodes, "ControllerNode", FakeNode)
    return ControllerNodes(bench.manager, cast(Any, None), cast(Any, FakeExecutor()), cast(Any, None))


@pytest.mark.parametrize("name", ["unmade", "unset", "undestroyed"])
def test_failing_node_is_logged_once_and_graph_becomes_complete(
    name: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench()
    nodes, registry = nodes_of(bench, monkeypatch), bench.manager.registry
    registry.load(ControllerSpec(name, bench.arm.kind, bench.arm.parameters))
    registry.configure(name, bench.arm)
    for _ in range(3):
        assert nodes.synchronize()
    assert set(nodes.controllers) >= {bench.arm, bench.hand}
    registry.unload(name)
    registry.load(ControllerSpec("later", bench.hand.kind, bench.hand.parameters))
    assert [nodes.synchronize() for _ in range(3)][-1]
    assert caplog.text.count("Traceback") == 1 and name in caplog.text


def test_clients_receive_responses_despite_failures_elsewhere() -> None:
    answered: list[bool] = []

    def fails() -> bool:
        raise RuntimeError("the graph")

    class Part:
        synchronize: Callable[[], bool] = staticmethod(fails)
        resume_done = staticmethod(lambda: answered.append(True))

    ros_nodes = cast(Any, StackNodes.__new__(StackNodes))
    ros_nodes._controllers = ros_nodes._pending = Part()
    with pytest.raises(RuntimeError, match="the graph"):
        ros_nodes._synchronize()
    assert answered
