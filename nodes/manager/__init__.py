"""The node ``/controller_manager`` and the nodes of the hardware components."""
