"""The YOLOv8-pose network of our own: what is in one picture, with boxes and keypoints."""
