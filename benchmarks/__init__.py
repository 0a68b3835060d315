"""Benchmarks of the stack, the bus and the simulation. Benchmarks print measured values; tests do not."""
