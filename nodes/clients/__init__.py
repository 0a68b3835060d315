"""Clients of a running stack: nodes that watch it, and nodes that measure it."""
