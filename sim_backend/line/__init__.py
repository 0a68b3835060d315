"""A bus of virtual servos: the servos, their power supply and the mechanics that they drive."""
