"""A stack with the default controllers and two more controllers for the same joints, which most tests of the manager
use."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from servoloop.stack.shipped_files import CONTROLLERS
from tests.ros.manager_client import BEST_EFFORT, ManagerClient
from tests.ros.stack_process import StackProcess, running

FORWARD: Final = "forward_command_controller/ForwardCommandController"
AT_START: Final = {
    "joint_state_broadcaster": "active",
    "arm_controller": "active",
    "hand_controller": "active",
    "conflict": "inactive",
    "spare": "inactive",
}
DONE: Final = "Successfully switched controllers!"

_MORE: Final = f"""
    conflict:
      type: {FORWARD}
    spare:
      type: {FORWARD}

conflict:
  ros__parameters: {{joints: [joint1], interface_name: position}}
spare:
  ros__parameters: {{joints: [joint6], interface_name: position}}
"""


@contextmanager
def manager_stack(folder: Path, namespace: str = "") -> Iterator[StackProcess]:
    """Run the stack in a namespace until the end of the block."""
    head, rest = CONTROLLERS.read_text().split("\narm_controller:\n")
    path = folder / "controllers.yaml"
    path.write_text(f"{head.rstrip()}\n{_MORE}\narm_controller:\n{rest}")
    with running(folder, "--hardware", "mock", "--controllers", str(path), "--namespace", namespace) as stack:
        yield stack


def restore(client: ManagerClient) -> None:
    """Restore the initial state of the controllers."""
    for name, wanted in AT_START.items():
        state = client.states().get(name)
        if state is None:
            assert client.load(name)
        if state in (None, "unconfigured"):
            assert client.configure(name)
        if state == "active" and wanted == "inactive":
            assert client.switch((), [name])[0]
    for name in [n for n in client.states() if n not in AT_START]:
        client.switch((), [name], BEST_EFFORT)
        assert client.unload(name)
    client.switch([n for n, wanted in AT_START.items() if wanted == "active"], (), BEST_EFFORT)
    assert client.states() == AT_START
