"""A client of /controller_manager that runs in the process of the test, separate from the stack."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration
from controller_manager_msgs.msg import ControllerState
from controller_manager_msgs.srv import (
    CleanupController,
    ConfigureController,
    ListControllers,
    LoadController,
    SetHardwareComponentState,
    SwitchController,
    UnloadController,
)
from lifecycle_msgs.msg import State
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python
from rclpy.task import Future

from tests.ros.stack_process import PATIENCE_S

MANAGER = "/controller_manager"
BEST_EFFORT, STRICT, AUTO, FORCE_AUTO = 1, 2, 3, 4  # of controller_manager_msgs/srv/SwitchController


class ManagerClient:
    """Client that calls services of a stack by their names in the root namespace, one after the other."""

    def __init__(self, name: str = "manager_client", namespace: str = "") -> None:
        self.namespace = namespace
        """Namespace of the stack."""
        self.node = Node(name)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self._clients: dict[str, Any] = {}

    def client(self, kind: Any, service: str) -> Any:
        """Return the client of a service after the service has been discovered."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, self.namespace + service)
            assert self._clients[service].wait_for_service(PATIENCE_S), service
        return self._clients[service]

    def wait(self, *futures: Future) -> list[Any]:
        """Wait for all results. Fail if no response arrives."""
        self.spin_until(lambda: all(future.done() for future in futures))
        return [future.result() for future in futures]

    def call(self, kind: Any, service: str, **fields: Any) -> Any:
        """Call a service with a request that has these fields, and return the response."""
        return self.wait(self.client(kind, service).call_async(kind.Request(**fields)))[0]

    def listed(self) -> dict[str, ControllerState]:
        """Return all controllers by name."""
        return {c.name: c for c in self.call(ListControllers, f"{MANAGER}/list_controllers").controller}

    def states(self) -> dict[str, str]:
        """Return the states of all controllers by name."""
        return {name: c.state for name, c in self.listed().items()}

    def load(self, name: str) -> bool:
        return bool(self.call(LoadController, f"{MANAGER}/load_controller", name=name).ok)

    def configure(self, name: str) -> bool:
        return bool(self.call(ConfigureController, f"{MANAGER}/configure_controller", name=name).ok)

    def cleanup(self, name: str) -> bool:
        return bool(self.call(CleanupController, f"{MANAGER}/cleanup_controller", name=name).ok)

    def unload(self, name: str) -> bool:
        return bool(self.call(UnloadController, f"{MANAGER}/unload_controller", name=name).ok)

    def switching(
        self,
        activate: Sequence[str] = (),
        deactivate: Sequence[str] = (),
        strictness: int = STRICT,
        timeout_s: int = 0,
    ) -> Future:
        """Request a switch and return its future."""
        request = SwitchController.Request(
            activate_controllers=list(activate),
            deactivate_controllers=list(deactivate),
            strictness=strictness,
            timeout=Duration(sec=timeout_s),
        )
        future: Future = self.client(SwitchController, f"{MANAGER}/switch_controller").call_async(request)
        return future

    def switch(
        self, activate: Sequence[str] = (), deactivate: Sequence[str] = (), strictness: int = STRICT
    ) -> tuple[bool, str]:
        """Switch controllers, and return whether this succeeded, and the message."""
        (answer,) = self.wait(self.switching(activate, deactivate, strictness))
        return bool(answer.ok), str(answer.message)

    def set_from_text(self, node: str, name: str, text: str) -> bool:
        """Set a parameter from YAML text, as the spawner does."""
        parameter = Parameter("any", value="").to_parameter_msg()
        parameter.name, parameter.value = name, get_parameter_value(string_value=text)
        (result,) = self.call(SetParameters, f"{node}/set_parameters", parameters=[parameter]).results
        return bool(result.successful)

    def put(self, node: str, name: str, value: Any) -> str:
        """Set a parameter. Return the reason for a failure, or an empty string."""
        message = Parameter(name, value=value).to_parameter_msg()
        (result,) = self.call(SetParameters, f"{node}/set_parameters", parameters=[message]).results
        assert result.successful == (not result.reason)
        return str(result.reason)

    def get(self, node: str, *names: str) -> list[Any]:
        """Return the values of parameters."""
        values = self.call(GetParameters, f"{node}/get_parameters", names=list(names)).values
        return [parameter_value_to_python(value) for value in values]

    def parameters(self, node: str) -> set[str]:
        """Return the names of all parameters."""
        return set(self.call(ListParameters, f"{node}/list_parameters").result.names)

    def set_hardware(self, label: str) -> None:
        """Set the state of the arm by its label."""
        service = f"{MANAGER}/set_hardware_component_state"
        assert self.call(SetHardwareComponentState, service, name="robot_arm", target_state=State(label=label)).ok

    def spin_until(self, ready: Callable[[], object], instead: Callable[[], object] = str) -> None:
        """Spin until a condition is true. Fail after a timeout, and report ``instead`` as the actual state."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not ready():
            assert time.monotonic() < deadline_s, f"never came: {instead()}"
            self.executor.spin_once(timeout_sec=0.1)

    @contextmanager
    def hearing(self, kind: Any, topic: str, qos: Any = 10) -> Iterator[list[Any]]:
        """Record the messages of a topic of the stack, starting when its publisher has been discovered."""
        messages: list[Any] = []
        subscription = self.node.create_subscription(kind, self.namespace + topic, messages.append, qos)
        try:
            self.spin_until(subscription.get_publisher_count)
            yield messages
        finally:
            self.node.destroy_subscription(subscription)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()


@contextmanager
def manager_client(namespace: str = "") -> Iterator[ManagerClient]:
    """Provide a client of a stack in a namespace, with its own ROS context."""
    rclpy.init()
    client = ManagerClient(namespace=namespace)
    try:
        yield client
    finally:
        client.close()
        rclpy.try_shutdown()
