"""Benchmarks of the stack, the bus and the simulation. Tests do not print the values that benchmarks measure."""
