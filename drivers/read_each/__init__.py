"""Servos that no group read reaches: each is asked by itself."""
