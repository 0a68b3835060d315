"""Motions around obstacles: the planner of an arm, its scene and poses of its tool."""
