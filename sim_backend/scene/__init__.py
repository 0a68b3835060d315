"""The arm and its surroundings in MuJoCo, and their pictures."""
