"""experiments/run."""
