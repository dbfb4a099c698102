"""A free form of the force that a driven body or a cycled link leaves unbalanced."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from discovery.decide.explanation import Explanation
from discovery.explain.force_balance import explanation, fitted
from discovery.explain.free_form import single_terms, sparse_sum, terms_at
from discovery.explain.scales import scale_of, sees_normal_force
from discovery.options import Options
from discovery.residual.force_balance import ForceBalanceResidual
from rom.effects import Effect


def explain(residual: ForceBalanceResidual, options: Options) -> tuple[Explanation, ...]:
    """The sparse sum in one link that leaves least of the training rows, with the residual beside it.

    Columns are the forces of the terms along the measured motion over the noise, what the model's numbers
    can balance taken off; so a sparse fit of them is one of the equation error. T is the normal force.
    """
    found = []
    for link in residual.balances.settings.link:
        effect = _in_link(residual, link.name, options)
        if effect is not None:
            after, (limited,) = fitted(residual, (effect,))
            explained = explanation(limited, residual, after)
            found.append(replace(explained, residual=after))
    return tuple(sorted(found, key=lambda one: one.cost(hold_out=False))[:1])


def _in_link(residual: ForceBalanceResidual, enters: str, options: Options) -> Effect | None:
    scale = scale_of(residual.balances, enters)
    if scale is None:
        return None
    normal = sees_normal_force(residual.balances, enters)
    terms = terms_at(scale.displacement, scale.velocity, tension=normal, criteria=options.criteria.tension)
    columns = [
        residual.beyond(residual.whitened(residual.force_of(one, training=True)))
        for one in single_terms(terms, enters)
    ]
    remainder = residual.beyond(residual.whitened(residual.force))
    return sparse_sum(np.stack(columns, axis=1), remainder, terms, enters, options.seed, options.criteria)
