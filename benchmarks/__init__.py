"""Benchmarks of the stack, the bus and the simulation. Tests print none of the figures that benchmarks measure."""
