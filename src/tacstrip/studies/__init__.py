"""Whole jobs: the demonstration, the thesis again."""
