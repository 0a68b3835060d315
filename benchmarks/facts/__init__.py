"""Facts about real servos, and the figures and curves that show how virtual servos agree with them."""
