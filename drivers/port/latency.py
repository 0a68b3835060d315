"""Check the latency timer of USB adapters. FTDI adapters delay received bytes by up to 16 ms by default."""

from pathlib import Path
from typing import Final

from drivers.paths import resolved

GOOD_MS: Final = 2
HELD_BACK: Final = (
    "the adapter or a hub delays replies: set the adapter's latency timer to 1 ms, and plug the adapter "
    "directly into the computer"
)
"""Advice about an adapter whose latency timer cannot be read."""
_SYS: Final = Path("/sys/class/tty")


def latency_advice(device: str, sys_tty: Path = _SYS) -> str | None:
    """Return how to shorten the adapter's latency timer, or None if it is short enough or there is none."""
    timer = sys_tty / resolved(device).name / "device" / "latency_timer"
    try:
        latency_ms = int(timer.read_text())
    except (OSError, ValueError):  # other types of adapters have no latency timer
        return None
    if latency_ms <= GOOD_MS:
        return None
    return (
        f"adapter {device} delays every reply by up to {latency_ms} ms: "
        f"run 'echo 1 | sudo tee {timer}' to set the delay to 1 ms until the adapter is unplugged"
    )
