"""Packets of the servo protocols: encoding and decoding without I/O."""
