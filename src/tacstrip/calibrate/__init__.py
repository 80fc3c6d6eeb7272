"""Constants of a unit, fitted to contacts of known place, with their uncertainty and provenance."""
