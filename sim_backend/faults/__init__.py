"""Faults of a virtual arm. docs/faults.md lists them by name.

``events`` has a class for each kind of fault. ``player`` starts and ends faults on time, ``script`` and ``text`` read
and write them, and ``draw`` makes random schedules. ``WireFaults`` has the switches for single replies on a line.
"""

from sim_backend.packets.faults import Disturbance, WireFaults

__all__ = ["Disturbance", "WireFaults"]
