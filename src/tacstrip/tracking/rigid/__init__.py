"""One rigid shape over many scans: its corners, and its pose in every scan, from the readings alone."""
