"""Apples: what they look like, and how they lie on the stand of an arm."""
