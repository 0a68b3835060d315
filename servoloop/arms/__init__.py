"""Create arm folders: for a new arm from its URDF, or for a robot with several arms from their folders."""
