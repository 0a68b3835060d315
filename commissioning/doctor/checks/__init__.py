"""Checks of the doctor. Each is a pure function that yields the findings in a snapshot."""
