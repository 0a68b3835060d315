"""Create the folder of a new arm from its URDF."""
