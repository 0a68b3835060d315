"""Invariants: conditions that must hold in every run, regardless of the faults."""

from servoloop.campaign.invariants.invariant import Invariant, Violation

__all__ = ["Invariant", "Violation"]
