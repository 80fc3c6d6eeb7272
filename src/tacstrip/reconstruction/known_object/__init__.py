"""The pose of a known rigid outline, from one scan."""
