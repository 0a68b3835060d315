"""Virtual buses: lines of servos that a program accesses through an in-process port or a pseudo-terminal."""
