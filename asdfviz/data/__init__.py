"""What comes from disk: assemblies, RGB-D sequences, saved runs."""
