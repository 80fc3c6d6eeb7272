"""Bounded noise: all outlines that the readings leave, their mean and guaranteed regions."""
