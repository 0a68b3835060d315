"""Read an arm's files for planning."""
