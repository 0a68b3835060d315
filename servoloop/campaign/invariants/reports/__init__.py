"""Invariants on what the stack reports."""
