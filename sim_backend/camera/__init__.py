"""Virtual camera: pictures of a MuJoCo scene as a camera takes them, and the true contents of the pictures."""
