"""discovery/explain."""
