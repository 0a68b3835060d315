"""Distances between the links of an arm and the objects of a scene, in compiled code."""
