"""Plane geometry of recovered and original shapes: outlines, moments, regions, mismatch."""
