"""Commands of the planner: the planning server, motions to a pose, and the objects of the scene."""
