"""Facts about real servos, with values and curves that show how closely the virtual servos match the real ones."""
