"""Which law the records support: race, cross-validation, pairs, confidence sets.

Belongs here: a measure by which fitted laws are ranked or told apart, and the result.
May import: `discovery.search`, `discovery.separating_tests` and what these may.
"""
