"""Campaigns: many runs with random faults on simulated time, and what must hold in each of them."""
