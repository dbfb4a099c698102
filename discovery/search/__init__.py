"""discovery/search."""
