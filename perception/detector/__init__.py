"""Grade apples with a detector of the user: an ONNX file in the layout of YOLOv8, and a file that maps its classes."""
