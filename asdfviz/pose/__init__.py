"""From keypoints and depth to the pose of one part: PnP, fit to the box, translation refinement."""
