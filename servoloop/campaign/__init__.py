"""Campaigns: many simulated runs with random faults, and the invariants that each run must satisfy."""
