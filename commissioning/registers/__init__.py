"""Read and write individual servos' registers by name, with units."""
