"""Virtual Dynamixel servos: control tables, firmware, identified motors."""
