"""The command line and the wiring: servoloop/ is the only folder that knows all others, and has no logic."""
