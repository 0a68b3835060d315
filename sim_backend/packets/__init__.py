"""The packets of the Feetech and Dynamixel protocols, and faults that change them on the wire."""
