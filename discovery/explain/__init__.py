"""Explainers: what each effect of the catalogue, or a form outside it, takes from a residual.

Belongs here: a module for each way in which effects show, with a function ``explain(residual, options)``
that returns an `Explanation` for every effect, and a line in `discovery.explain.registry`. Nothing is
accepted or refused here.
May import: `discovery.residual`, `discovery.localisation`, `discovery.decide`, `discovery.search`,
`discovery.courses`, criteria and options; nothing of `discovery.loop`.
"""
