"""discovery/views."""
