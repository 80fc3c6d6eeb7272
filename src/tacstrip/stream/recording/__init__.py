"""Recordings in MCAP: written, read, summarised, recovered."""
