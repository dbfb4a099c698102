"""From libraries of factors and sparse fits to a short list of laws: `LIBRARIES`, `OPTIMIZERS`.

Belongs here: a family of factors, an optimizer, a quick score.
May import: `discovery.courses`, `discovery.laws`, criteria and options, and `rom`.
"""
