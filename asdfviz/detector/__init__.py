"""The YOLOv8-pose network of our own: what is in one picture, with boxes and keypoints."""

import os

# Torch's threads wait busily for their next piece of work, by default for milliseconds, and so take the
# cores from whatever comes after the network. A fifteenth of that still lasts from layer to layer.
os.environ.setdefault("GOMP_SPINCOUNT", "20000")
