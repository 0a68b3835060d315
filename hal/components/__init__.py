"""Set of hardware components that the control loop uses as one hardware. Each component has its own life cycle."""
