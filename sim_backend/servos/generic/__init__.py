"""Control loop, table and instructions of servos other than STS. The simulation follows the manuals where they
describe these servos."""
