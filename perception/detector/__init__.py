"""Grade apples with the user's detector: an ONNX file in the YOLOv8 layout, and a file that assigns a grade to each
class."""
