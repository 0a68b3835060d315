"""Checks judge a snapshot: each is a pure function that yields findings."""
