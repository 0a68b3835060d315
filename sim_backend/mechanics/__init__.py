"""Motors, gears, backlash and supply: the servos' physics in SI units."""
