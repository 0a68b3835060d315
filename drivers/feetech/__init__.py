"""Feetech serial bus servos: the STS table, the packets, the bus."""
