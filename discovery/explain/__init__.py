"""Explainers: what each effect of the catalogue, or a form outside it, takes from a residual.

Belongs here: a module for each way in which effects show, with a function ``explain(residual, options)``
that returns an `Explanation` for every effect, and a line in `discovery.explain.registry`. Nothing is
accepted or refused here.
May import: `discovery.decide`, `discovery.search`, `discovery.localisation`, `discovery.residual`,
`discovery.courses`, `discovery.laws`, criteria and options, and `rom`; nothing of `discovery.loop`.
"""
