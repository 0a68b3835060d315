"""Facts about real servos, with the figures and curves that show how closely the virtual servos match them."""
