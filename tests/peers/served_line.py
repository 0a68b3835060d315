"""Serve a virtual line on a pseudo-terminal for a client that treats it as real.

Usage: ``python served_line.py LINK MODEL ID...``. It runs in its own process, because a client may block its
interpreter while it waits. It has the priority of ``servoloop emulate``, because the SDKs of the manufacturers wait 34
ms for a reply.
"""

import signal
import sys
from pathlib import Path

from drivers.servos.catalog import MODELS, series_of
from servoloop.stack.processes import realtime_priority
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.emulator import serve
from sim_backend.mechanics.plant import BenchPlant


def main() -> None:
    link, model, *ids = sys.argv[1:]
    models = dict.fromkeys(map(int, ids), MODELS[model])
    protocol2 = series_of(MODELS[model]).protocol.name == "Dynamixel protocol 2.0"
    line = (VirtualDynamixelBus if protocol2 else VirtualBus).of(BenchPlant(list(models)), models)
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: ended.append(1))
    with realtime_priority():
        serve(line, Path(link), stop=lambda: bool(ended), on_ready=lambda: print("ready", flush=True))


if __name__ == "__main__":
    main()
