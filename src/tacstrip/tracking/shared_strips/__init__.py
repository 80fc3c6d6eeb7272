"""Several objects on the same strips: known from scans in which each was alone, their poses from what all read together."""
