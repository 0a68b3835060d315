"""Drivers under comparison, as clients of a benchmark."""
