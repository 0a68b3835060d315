"""The ``/controller_manager`` node and the nodes of the hardware components."""
