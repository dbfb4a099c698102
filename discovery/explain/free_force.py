"""A free form of the force that a driven body or a cycled link leaves unbalanced."""

from __future__ import annotations

import numpy as np

from discovery.decide.explanation import Explanation
from discovery.explain.force_balance import ForceBalanceResidual, explained, fitted
from discovery.explain.free_form import member_of, single_terms, sparse_sum, terms_at
from discovery.explain.scales import scale_of, sees_normal_force
from rom.campaign.channels import FloatArray
from rom.effects import Effect


def free_force(state: ForceBalanceResidual, seed: int = 0) -> tuple[Explanation, ForceBalanceResidual] | None:
    """The sparse sum in one link that leaves least of the training rows, and the state with it.

    Columns are the forces of the terms along the measured motion over the noise, what the model's numbers
    can balance taken off; so a sparse fit of them is one of the equation error. T is the normal force.
    """
    found = []
    for link in state.balances.settings.link:
        effect = _in_link(state, link.name, seed)
        if effect is not None:
            after, (limited,) = fitted(state, (effect,))
            found.append((explained(limited, member_of(limited), state, after), after))
    return min(found, key=lambda one: one[0].cost(hold_out=False), default=None)


def _in_link(state: ForceBalanceResidual, enters: str, seed: int) -> Effect | None:
    balances, scale = state.balances, scale_of(state.balances, enters)
    if scale is None:
        return None
    rows = balances.training
    basis = np.linalg.qr(balances.columns[rows] / balances.noise[rows, None])[0]

    def beyond(force: FloatArray) -> FloatArray:
        white = force[rows] / balances.noise[rows]
        return np.asarray(white - basis @ (basis.T @ white))

    terms = terms_at(scale.displacement, scale.velocity, tension=sees_normal_force(balances, enters))
    columns = [beyond(state.of(one, training=True)) for one in single_terms(terms, enters)]
    return sparse_sum(np.stack(columns, axis=1), beyond(state.force), terms, enters, seed)
