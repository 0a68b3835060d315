"""One line of servos: group reads and writes, calls to single servos, late replies, faults, counters."""
