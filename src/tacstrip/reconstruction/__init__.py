"""From scans back to shapes."""
