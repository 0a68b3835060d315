"""The arm and its surroundings in MuJoCo, and images of the scene."""
