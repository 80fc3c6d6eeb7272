"""Hold-out cases: shapes, physics and noise of their own, which decide whether an estimate may be trusted."""
