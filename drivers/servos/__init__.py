"""Control tables, models and series of servos."""
