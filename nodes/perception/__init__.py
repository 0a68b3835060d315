"""The camera node, which publishes camera images and grades the apples in them."""
