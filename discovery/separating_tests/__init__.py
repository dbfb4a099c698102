"""discovery/separating_tests."""
