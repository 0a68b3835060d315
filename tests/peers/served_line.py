"""Serve a virtual line on a pseudo-terminal for a client that treats it as a real line.

Arguments: LINK MODEL[,MODEL...] ID..., with one model for all servos or one for each. The line runs in a separate
process, because a client may hold Python's interpreter lock while it waits. The process has the priority of ``servoloop
emulate``, because the makers' SDKs wait only 34 ms for an answer.
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
    link, names, *ids = sys.argv[1:]
    each = names.split(",") if "," in names else [names] * len(ids)
    models = {int(i): MODELS[name] for i, name in zip(ids, each, strict=True)}
    protocol2 = series_of(MODELS[each[0]]).protocol.name == "Dynamixel protocol 2.0"
    line = (VirtualDynamixelBus if protocol2 else VirtualBus).of(BenchPlant(list(models)), models)
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: ended.append(1))
    with realtime_priority():
        serve(line, Path(link), stop=lambda: bool(ended), on_ready=lambda: print("ready", flush=True))


if __name__ == "__main__":
    main()
