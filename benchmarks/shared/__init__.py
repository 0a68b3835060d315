"""Command-line arguments and time measurements for benchmarks."""
