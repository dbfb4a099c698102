"""rom/signals."""
