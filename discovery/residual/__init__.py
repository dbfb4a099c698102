"""discovery/residual."""
