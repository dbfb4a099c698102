"""discovery/courses."""
