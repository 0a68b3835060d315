"""Invariants on the commands of controllers and on the goals that servos receive."""
