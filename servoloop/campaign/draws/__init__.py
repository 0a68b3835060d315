"""Draws of arms, clients and faults from the seed of a run."""
