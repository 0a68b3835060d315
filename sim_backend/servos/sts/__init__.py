"""Virtual STS servo: control table, firmware and compiled kernel."""
