"""Apples: their appearance and their position on an arm's stand."""
