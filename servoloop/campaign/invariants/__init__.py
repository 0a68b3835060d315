"""Invariants: conditions that must hold in every run, whatever faults happen."""
