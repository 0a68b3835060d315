"""Dynamixel servos: the X series' table, protocol 2.0's packets, the bus."""
