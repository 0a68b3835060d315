"""The arm and its surroundings in MuJoCo, and pictures of them."""
