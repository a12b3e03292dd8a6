"""Real-time 6D tracking of known parts: viewpoint models, region and depth modalities, Newton steps."""
