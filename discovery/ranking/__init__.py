"""Which law the records support: race, cross-validation, pairs, confidence sets.

Belongs here: a measure by which fitted laws are ranked or distinguished, and the result.
May import: `discovery.search`, `discovery.separating_tests`, `discovery.courses`, `discovery.laws`, criteria
and options, and `rom`; nothing of `discovery.loop`.
"""
