"""The Python interface to an arm: ``servoloop.Arm``, its state, its errors and its connection to a control loop."""
