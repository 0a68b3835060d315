"""The servos' side of the wire: packets, lines and ports, in process or on a pseudo-terminal."""
