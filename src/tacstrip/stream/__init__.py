"""Scans as they come: sources, recordings, and the way between them."""
