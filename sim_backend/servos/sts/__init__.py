"""What is inside a virtual STS servo: its table, its millisecond, its motor."""
