"""Virtual buses: lines of servos that a program reaches through an in-process port or a pseudo-terminal."""
