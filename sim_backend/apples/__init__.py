"""Apples: their appearance, and how they lie on the stand of an arm."""
