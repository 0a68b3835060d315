"""A user's own controller with a face of its own, installed beside the stack: on the graph like the others."""

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from std_msgs.msg import Float64

from tests.controller.test_manager_plugin import block, install
from tests.ros.manager_client import MANAGER, manager_client
from tests.ros.stack_process import running

pytestmark = pytest.mark.ros

FACES = """
from std_msgs.msg import Float64


class Face:
    def __init__(self, node, controller):
        self.controller = controller
        self.publisher = node.create_publisher(Float64, "~/swing", 10)

    def publish(self, stamp):
        if self.controller.parameters.amplitude > 0.5:
            raise RuntimeError("too wide")
        self.publisher.publish(Float64(data=float(self.controller.command[0])))
"""


def test_a_users_controller_and_its_face(ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, "wave", block("python"), "wave/Wave = wave:Wave\n[servoloop.faces]\nwave/Wave = wave_face:Face")
    (tmp_path / "wave_face.py").write_text(FACES)
    (tmp_path / "controllers.yaml").write_text(block("yaml"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    options = ("--hardware", "mock", "--controllers", str(tmp_path / "controllers.yaml"))
    with running(tmp_path, *options) as stack, manager_client() as client:
        swings: list[float] = []
        client.node.create_subscription(Float64, "/wave/swing", lambda message: swings.append(message.data), 10)
        assert client.states() == {"wave": "active"}
        client.spin_until(lambda: max(swings, default=0.0) > 0.05)
        assert "read-only" in client.put("/wave", "joint", "joint1")
        assert "greater than or equal to 0" in client.put("/wave", "amplitude", -1.0)
        assert client.put("/wave", "amplitude", 0.6) == ""  # its face fails from here on, and nobody else
        client.spin_until(lambda: "wave shows nothing from here on" in stack.words)
        assert client.states() == {"wave": "active"}
        assert client.switch((), ["wave"])[0] and client.unload("wave")
        client.spin_until(lambda: "wave" not in client.node.get_node_names())
        assert client.get(MANAGER, "wave.type") == ["wave/Wave"]
