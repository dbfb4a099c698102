"""discovery/decide."""
