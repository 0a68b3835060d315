"""The camera node, which publishes the images of a camera and grades the apples in them."""
