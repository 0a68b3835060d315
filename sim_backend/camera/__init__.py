"""Virtual camera: pictures of a MuJoCo scene as a camera takes them, and what the pictures really show."""
