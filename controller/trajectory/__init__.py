"""The joint trajectory controller: goals are checked, planned, sampled once a cycle and held against tolerances."""
