"""rom/model."""
