"""discovery/laws."""
