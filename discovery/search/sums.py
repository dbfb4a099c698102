"""Sums of columns: which supports the sparse fits of libraries find, fitted and judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discovery.criteria.criteria import Criteria
from discovery.search.optimizers import Path, sparse_supports
from discovery.search.quick_likelihood import Found, best_pairs, fitted_sum
from discovery.search.sparse_regression import Rows, least_squares, usable
from rom.campaign.channels import FloatArray


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums of terms from the sparse fits of several libraries, all parts of one table of columns.

    ``plain`` rows are whitened by the noise alone and judge; ``damped`` ones also by the scatter and feed the
    sparse fits. ``optimizers`` is None for all of ours and the best pairs of columns; ``credited``: single
    columns name the optimizers that select them too.
    """

    plain: Rows
    damped: Rows
    singles: Sequence[Found]
    tightening: bool
    criteria: Criteria
    optimizers: Mapping[str, Path] | None = None
    credited: bool = False

    def distinct(
        self, names: Sequence[str], libraries: Mapping[str, Sequence[int]], rng: np.random.Generator
    ) -> tuple[list[Found], tuple[str, ...]]:
        """Find every distinct sum on the paths of the sparse fits, and the best pairs.

        Parameters
        ----------
        names : sequence of str
            Of all columns.
        libraries : mapping of str to sequence of int
            Columns of every library by its label in sources.
        rng : numpy.random.Generator
            Source of ensembles.

        Returns
        -------
        tuple of (list of Found, tuple of str)
            Single columns and sums; names of columns that no sparse fit can take.
        """
        sources: dict[frozenset[int], tuple[str, ...]] = {}
        dropped: dict[str, None] = {}
        for label, members in libraries.items():
            theta, target = self.stacked(members)
            kept, gone = usable(theta, [names[k] for k in members])
            dropped |= dict.fromkeys(gone)
            if len(kept) < 2:
                continue
            place = [members[k] for k in kept]
            supports = {
                support: tuple(f"pysindy:{label}/{optimizer}" for optimizer in optimizers)
                for support, optimizers in sparse_supports(
                    theta[:, kept], target, rng, self.tightening, self.criteria.search, self.optimizers
                ).items()
            }
            for pair in self._pairs(place):
                supports[frozenset(pair)] = (
                    *supports.get(frozenset(pair), ()),
                    f"pysindy:{label}/best pairs",
                )
            for support, texts in supports.items():
                whole = frozenset(place[k] for k in support)
                sources[whole] = tuple(dict.fromkeys((*sources.get(whole, ()), *texts)))
        sums = [self._fitted(support, texts) for support, texts in sources.items() if len(support) > 1]
        singles = [
            replace(one, sources=(*one.sources, *sources.get(frozenset(one.columns), ()) * self.credited))
            for one in self.singles
        ]
        return [*singles, *sums], tuple(dropped)

    def stacked(self, members: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Damped rows of some columns, those of all cases below each other, and their target."""
        return self.damped.columns[:, :, members].reshape(-1, len(members)), self.damped.target.ravel()

    def _pairs(self, members: Sequence[int]) -> list[tuple[int, int]]:
        """Places in ``members`` of the best pairs."""
        if self.optimizers is not None or self.criteria.search.largest_support < 2:
            return []
        sizes = {found.columns[0]: found.coefficients[0] for found in self.singles}
        alone = [k for k, column in enumerate(members) if column in sizes]
        chosen = [members[k] for k in alone]
        rows = Rows(self.plain.columns[:, :, chosen], self.plain.target)
        values, count = np.array([sizes[k] for k in chosen]), int(self.criteria.search.pairs)
        pairs = best_pairs(rows, values, count, self.tightening, self.criteria.courses)
        return [(alone[j], alone[k]) for j, k in pairs]

    def _fitted(self, support: frozenset[int], sources: tuple[str, ...]) -> Found:
        members = sorted(support)
        start = least_squares(*self.stacked(members), signed=self.tightening)
        return fitted_sum(self.plain, members, start, sources, self.criteria.courses)
