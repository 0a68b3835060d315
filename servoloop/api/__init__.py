"""The Python interface of an arm: ``servoloop.Arm``, its state, its errors and its connection to a control loop."""
