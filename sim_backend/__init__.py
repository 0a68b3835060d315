"""Virtual servos, the simulated world and clock: what stands in for hardware, below the wire."""
