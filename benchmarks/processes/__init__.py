"""Processes that a benchmark starts and measures, and the load beside them."""
