"""Drivers to compare, as clients of a benchmark."""
