"""Benchmarks of the motion planner."""
