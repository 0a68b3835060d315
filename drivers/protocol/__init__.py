"""The bytes of the servo protocols: packets from values and back, without I/O."""
