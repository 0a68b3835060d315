"""Calibration scripts' tools for single servos, above the bus: no cycle of an arm passes here."""
