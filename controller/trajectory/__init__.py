"""Execute joint trajectory goals: check and plan a goal, sample its path in each cycle and check the tolerances."""
