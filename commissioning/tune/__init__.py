"""``servoloop tune``: how one joint follows with its servo's gains, and which gains would be better."""
