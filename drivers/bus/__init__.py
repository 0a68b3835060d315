"""Servo bus: group reads and writes, requests to single servos, late replies, faults and counters."""
