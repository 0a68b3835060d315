"""Who is on a line: every rate, every make, and what is wrong with whom. Only pings and reads."""
