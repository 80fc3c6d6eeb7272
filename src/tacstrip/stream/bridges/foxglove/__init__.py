"""Foxglove and Lichtblick: frames as their messages, and a server that these viewers connect to."""
