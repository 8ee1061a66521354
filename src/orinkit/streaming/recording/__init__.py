"""Recording of streams."""
