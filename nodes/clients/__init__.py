"""Clients of a running stack: nodes that monitor the stack and nodes that measure its timing."""
