"""rom/evaluation."""
