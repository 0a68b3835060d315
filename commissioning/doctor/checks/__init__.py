"""Checks performed by the doctor. Each check is a pure function that yields the findings for a snapshot."""
