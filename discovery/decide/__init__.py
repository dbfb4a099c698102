"""Whether an effect is accepted: significance, gains, effect sizes, errors on hold-out records.

Belongs here: a rule that accepts or refuses what an explainer returned (`Explanation`), and the null
distribution that it needs. A number that decides is in `discovery.criteria`.
May import: `discovery.residual`, criteria and options, and `rom`; nothing that fits an effect.
"""
