"""Grade apples with the user's detector: an ONNX file in the layout of YOLOv8, and a file with grades per class."""
