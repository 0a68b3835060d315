"""The control loop, table and instructions of the servos that are not STS: by the manuals, as far as they go."""
