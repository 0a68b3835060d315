"""Processes that a benchmark starts and measures, and processes that create load."""
