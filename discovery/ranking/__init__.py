"""discovery/ranking."""
