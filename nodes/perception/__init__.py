"""The camera node: publishes the pictures of a camera and the apples that it grades in them."""
