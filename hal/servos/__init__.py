"""Hardware component for serial bus servos: setup, activation, states, goals and faults."""
