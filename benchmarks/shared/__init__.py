"""Arguments and time measurements of the benchmarks."""
