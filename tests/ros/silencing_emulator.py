"""Emulate seven servos at a given path. SIGUSR1 disconnects servo 4.

Usage: python tests/ros/silencing_emulator.py LINK
"""

import signal
import sys
from pathlib import Path

from servoloop.stack.emulator import couplings
from servoloop.stack.robot_files import read_files
from sim_backend.buses.feetech import VirtualBus
from sim_backend.emulator import serve
from sim_backend.mechanics.plant import WorldPlant
from sim_backend.scene.world import World

SILENT_ID = 4


def main() -> None:
    bus = VirtualBus.of(WorldPlant(World(), couplings(read_files().robot)))
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ended.append(number))
    signal.signal(signal.SIGUSR1, lambda number, _: bus.faults.silence(SILENT_ID))
    serve(bus, Path(sys.argv[1]), stop=lambda: bool(ended))


if __name__ == "__main__":
    main()
