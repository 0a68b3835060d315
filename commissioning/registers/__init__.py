"""Read and write registers of single servos by name, with units."""
