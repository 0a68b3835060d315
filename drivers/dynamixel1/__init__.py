"""Dynamixel protocol 1.0: the AX and MX tables. The bus is ``drivers.read_each``."""
