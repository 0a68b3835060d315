"""Virtual buses: lines of servos behind a port of this process or behind a pseudo-terminal."""
