"""Pictures, without a display."""
