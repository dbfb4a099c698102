"""experiments/figures."""
