"""Checks of the doctor. Each check is a pure function that yields the findings in a snapshot."""
