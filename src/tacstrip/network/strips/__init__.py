"""Strip sensors as networks of resistors: one ladder per strip, or strips resolved across their width."""
