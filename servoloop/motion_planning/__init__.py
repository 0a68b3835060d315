"""Read the files of an arm for planning."""
