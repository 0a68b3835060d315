"""The packets of the Feetech and Dynamixel protocols, and faults that change packets on the wire."""
