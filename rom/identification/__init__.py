"""rom/identification."""
