"""A running stream: the pipeline from a source to recorders and sinks."""
