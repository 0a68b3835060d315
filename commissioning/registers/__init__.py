"""Single servos by register name: what they hold in units, and careful writes."""
