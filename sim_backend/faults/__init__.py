"""Everything that can go wrong with a virtual arm, by name: docs/faults.md has the list.

``events`` has a class for each kind, ``player`` lets events happen at their times, ``script`` and ``text`` read and
write them, ``draw`` makes a random schedule. ``wire`` has the switches for single replies that a line looks at.
"""

from sim_backend.packets.faults import Disturbance, WireFaults

__all__ = ["Disturbance", "WireFaults"]
