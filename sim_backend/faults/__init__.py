"""Faults of a virtual arm. docs/faults.md lists the faults by name.

``events`` contains one class for each fault type. ``player`` starts and ends faults on time. ``script`` and ``text``
read and write faults, and ``draw`` generates random schedules. ``WireFaults`` contains the switches for faults of
individual replies on a bus.
"""

from sim_backend.packets.faults import Disturbance, WireFaults

__all__ = ["Disturbance", "WireFaults"]
