"""Constructions, the spec file, the closed forms, the surface."""
