"""Nobody waits for ever for the middleware to let a process go."""

import subprocess
import sys

HANGS = "import time\nfrom nodes.ros_process import exit_watchdog\nwith exit_watchdog(0.2): time.sleep(60)\n"
LEAVES = "import time\nfrom nodes.ros_process import exit_watchdog\nwith exit_watchdog(0.2): pass\ntime.sleep(0.5)\n"


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50, check=False)


def test_a_process_that_cannot_leave_is_ended_and_says_where_it_hung() -> None:
    ended = run(HANGS)
    assert ended.returncode == 1
    assert "Timeout" in ended.stderr and "<module>" in ended.stderr


def test_one_that_has_left_goes_on() -> None:
    ended = run(LEAVES)
    assert (ended.returncode, ended.stderr) == (0, "")
