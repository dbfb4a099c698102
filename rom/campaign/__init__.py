"""rom/campaign."""
