"""Virtual buses with servos, which a program accesses through an in-process port or a pseudo-terminal."""
