"""Objects from scan to scan."""
