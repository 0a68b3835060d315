"""Forward and inverse kinematics of a tool, goal regions and straight tool paths."""
