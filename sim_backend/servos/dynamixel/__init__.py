"""Virtual Dynamixel servos: control tables, firmware and identified motors."""
