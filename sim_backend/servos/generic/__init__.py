"""Control loop, table and instructions of servos other than STS. The simulation follows the manuals as far as they
describe these servos."""
