"""Test your own nodes, controllers and robot files on virtual servos. See docs/test-your-robot.md."""
