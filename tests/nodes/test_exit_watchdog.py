"""The watchdog ends a process whose middleware does not shut down."""

import subprocess
import sys

import pytest

HANGS = "import time\nfrom nodes.ros_process import exit_watchdog\nwith exit_watchdog(0.2): time.sleep(60)\n"
LEAVES = "import time\nfrom nodes.ros_process import exit_watchdog\nwith exit_watchdog(0.2): pass\ntime.sleep(0.5)\n"
WATCHER_HANGS = """
import time
from nodes.clients import client_node
watchdog = client_node.exit_watchdog
client_node.exit_watchdog = lambda: watchdog(0.2)
watching = client_node.WatchingNode("watcher", "")
watching.start()
watching.node.destroy_node = lambda: time.sleep(60)
watching.close()
"""


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50, check=False)


def test_hanging_process_is_ended_with_a_traceback() -> None:
    ended = run(HANGS)
    assert ended.returncode == 1
    assert "Timeout" in ended.stderr and "<module>" in ended.stderr


def test_process_continues_after_leaving_in_time() -> None:
    ended = run(LEAVES)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.ros
def test_viewer_that_does_not_leave_the_graph_is_ended(ros_domain: int) -> None:
    pytest.importorskip("rclpy")
    ended = run(WATCHER_HANGS)
    assert ended.returncode == 1
    assert "Timeout" in ended.stderr and "in close" in ended.stderr
