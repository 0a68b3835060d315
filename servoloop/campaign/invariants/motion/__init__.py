"""Invariants on the motion of the joints."""
