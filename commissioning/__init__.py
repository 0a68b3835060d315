"""From new servos to a calibrated arm: what the command line's tools do, as functions for scripts. No ROS."""
