"""Benchmarks of the stack, the bus and the simulation. Tests never print such figures."""
