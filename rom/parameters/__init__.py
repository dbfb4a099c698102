"""Published parameter sets, a file per paper."""
