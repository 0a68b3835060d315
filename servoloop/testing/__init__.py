"""Tests of your own nodes, controllers and robot files on virtual servos: docs/test-your-robot.md."""
