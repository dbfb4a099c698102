"""What to know of balances of force: noise that makes numbers too small, forces of the other sign."""

from __future__ import annotations

import numpy as np

from rom.criteria.identification import RULES
from rom.identification.force_balance import Balances, noise_share


def noise_warnings(balances: Balances) -> tuple[str, ...]:
    """A line where noise behind the filter makes numbers too small."""
    share = noise_share(balances)
    if share <= RULES.noise_bias:
        return ()
    return (
        f"noise makes {100 * share:.2g} % of the square of a term behind the filter: its number comes out "
        "too small by as much, and what is left over may pass for an effect",
    )


def sign_warnings(balances: Balances) -> tuple[str, ...]:
    """Links whose damping is below zero beyond chance: their force was measured with the other sign."""
    lines = []
    for link in balances.settings.link:
        rows = [
            (balance.terms["force"], balance.terms[f"{link.name}.x"], balance.terms[f"{link.name}.v"])
            for record in balances.records
            if record.settings.test == "cycled" and not record.settings.hold_out
            for balance in record.balances
            if balance.place == link.name
        ]
        if rows:
            force, x, v = (np.concatenate(column) for column in zip(*rows, strict=True))
            table = np.stack([v, x, np.ones_like(x)], axis=1)
            found = np.linalg.lstsq(table, force, rcond=None)[0]
            spread = float(np.mean((force - table @ found) ** 2))
            error = np.sqrt(spread * np.linalg.pinv(table.T @ table, hermitian=True)[0, 0])
            if found[0] < -RULES.beyond_chance * error:
                lines.append(
                    f"link_force_{link.name}: gives out energy along the motion; expected the force that "
                    "pulls the first body back, turn its sign round"
                )
    return tuple(lines)
