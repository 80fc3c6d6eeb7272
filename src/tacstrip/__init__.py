"""tacstrip."""
