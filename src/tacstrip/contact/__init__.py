"""What touches, where, and the errors that readings of it have."""
