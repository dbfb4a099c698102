"""Where a residual lives: in which body and channel, at which amplitude, time, frequency, tension and sign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Profile = tuple[tuple[str, float], ...]  # label and residual's mean square over that of the noise floor


@dataclass(frozen=True)
class Localisation:
    """Mean square of the whitened residual, 1 at the noise floor, along each of several views.

    Attributes
    ----------
    by_channel, by_test, by_frequency, by_time, by_preload, by_amplitude : tuple of (str, float)
        A label and the mean square there.
    even_share, rate_free_share : float
        Share of the residual joint force that is even in the displacement; that is out of phase with it.
    whiteness_p : float
        Chance of so much dependence between neighbouring lines where nothing is left but noise.
    total : float
        Mean square over all.
    """

    by_channel: Profile
    by_test: Profile
    by_frequency: Profile
    by_time: Profile
    by_preload: Profile
    by_amplitude: Profile
    even_share: float
    rate_free_share: float
    whiteness_p: float
    total: float

    def as_dict(self) -> Mapping[str, object]:
        """Return plain values for a result file."""
        views = ("by_channel", "by_test", "by_frequency", "by_time", "by_preload", "by_amplitude")
        plain = ("even_share", "rate_free_share", "whiteness_p", "total")
        return {view: dict(getattr(self, view)) for view in views} | {k: getattr(self, k) for k in plain}
