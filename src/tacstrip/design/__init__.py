"""What to build: error bounds of a sensor, and designs that reach a wanted error."""
