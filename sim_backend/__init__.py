"""Virtual servos, simulated world and simulated clock, which replace the hardware below the drivers."""
