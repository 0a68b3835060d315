"""Virtual camera: images of a MuJoCo scene, and ground truth for these images."""
