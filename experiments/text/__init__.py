"""experiments/text."""
