"""Planner commands: the planning server, motions to a pose, and the objects in the scene."""
