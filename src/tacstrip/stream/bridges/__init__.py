"""Live objects in the formats of other programs."""
