"""Invariants: conditions that must hold in every run, whatever faults happen."""

from servoloop.campaign.invariants.invariant import Invariant, Violation

__all__ = ["Invariant", "Violation"]
