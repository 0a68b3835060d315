"""Set of hardware components that the control loop treats as one. Each component has its own life cycle."""
