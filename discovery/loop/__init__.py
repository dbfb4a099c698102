"""discovery/loop."""
