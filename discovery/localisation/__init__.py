"""discovery/localisation."""
