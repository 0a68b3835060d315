"""USB adapters that hold bytes back: FTDI's gather them for 16 ms unless told otherwise."""

from pathlib import Path
from typing import Final

GOOD_MS: Final = 2
HELD_BACK: Final = (
    "the adapter or a hub holds the replies back: set its latency timer to 1 ms and plug it straight into the computer"
)
"""Advice where nothing is known of the adapter's timer."""
_SYS: Final = Path("/sys/class/tty")


def latency_advice(device: str, sys_tty: Path = _SYS) -> str | None:
    """What to do about the adapter's latency timer, if it has one and it is too slow."""
    timer = sys_tty / Path(device).resolve().name / "device" / "latency_timer"
    try:
        latency_ms = int(timer.read_text())
    except (OSError, ValueError):  # another kind of adapter
        return None
    if latency_ms <= GOOD_MS:
        return None
    return (
        f"the adapter {device} holds every reply back for up to {latency_ms} ms: "
        f"run 'echo 1 | sudo tee {timer}' (until it is unplugged) for a fast bus"
    )
