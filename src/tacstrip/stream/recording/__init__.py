"""Recordings in MCAP: written, read, summed up, repaired."""
