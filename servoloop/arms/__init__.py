"""Arms that are ready to use: each a folder with its robot file, URDF, scene, controllers and pick-place parameters."""
