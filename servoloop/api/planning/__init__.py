"""Motions around obstacles: an arm's planner, its scene and its tool poses."""
