"""Invariants on goals, streams and messages of clients."""
