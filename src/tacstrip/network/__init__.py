"""Sensors as networks of resistors: what a real one does, and the check of the closed forms."""
