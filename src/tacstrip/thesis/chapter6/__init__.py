"""Chapter 6: the three prototypes as digital twins."""
