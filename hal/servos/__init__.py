"""Serial bus servos as a hardware component: set-up, activation, states, goals, faults."""
