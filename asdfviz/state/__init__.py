"""From detections and poses to the assembly state: appearance, relative pose, Pose2State."""
