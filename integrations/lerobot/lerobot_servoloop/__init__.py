"""Arms of running servoloop stacks, in the units of LeRobot. Most modules need only the standard library."""
