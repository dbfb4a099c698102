"""experiments/studies/blind."""
