"""Several objects on the same strips: shapes from scans in which each was alone, poses from what all read together."""
