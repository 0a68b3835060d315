"""The virtual servos: firmware and control table of each series."""
