"""Vertex Reconstruction (thesis, 4.2): a convex polygon from one signature."""
