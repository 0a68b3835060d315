"""Motors, gears and plants: the mechanics of servos in SI units."""
