"""Virtual camera: images of a MuJoCo scene, and the true contents of the images."""
