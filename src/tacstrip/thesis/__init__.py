"""The thesis, chapter by chapter."""
