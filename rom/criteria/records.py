"""Doubts that a record raises by itself: clipped channels, flipped signs, hits that the force misses."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rom.criteria.number import Group, number


@dataclass(frozen=True)
class Records(Group):
    """Doubts that a record raises by itself: clipped channels, flipped signs, hits that the force misses."""

    contact_share: float = number(0.02, "1", "share of a hit's peak force below which the contact is over")
    shortest_pulse: int = number(4, "1", "samples of a contact, below which it has no shape")
    usual_hz: float = number(
        25.0, "Hz", "frequency of the strongest motion, below which the times after a hit are longer"
    )
    shortest_ringing_s: float = number(
        0.3, "s", "time after a hit, below which the lowest mode does not show"
    )
    longest_ringing_s: float = number(3.0, "s", "time after a hit in which the lowest mode is sought")
    lowest_hz: float = number(2.0, "Hz", "frequency below which a displacement from an acceleration is drift")
    momentum_window_s: float = number(
        0.25, "s", "time after a hit over which the balance of momentum looks for a second one"
    )
    joint_window_s: float = number(
        0.02, "s", "time after a hit over which the balance of momentum tells a sign"
    )
    guard_s: float = number(0.005, "s", "time about a hit that belongs to it still")
    hit_share: float = number(0.03, "1", "smallest second hit, as a share of the first")
    hit_noise: float = number(8.0, "1", "smallest second hit, in noise of its estimate")
    hit_likeness: float = number(0.8, "1", "least correlation of a second hit's shape with the first")
    hit_alone: float = number(
        2.5, "1", "factor by which a second hit exceeds what recurs", "contacts in the structure recur"
    )
    moved: float = number(4.0, "1", "motion in noise of the channel, below which its sign is open")
    opposed: float = number(0.7, "1", "size of the correlation from which motions agree or oppose each other")
    unturned: float = number(
        0.7, "1", "misfit of momentum with a sign as it is, over that with it turned, that denies a flip"
    )
    fine_steps: float = number(
        10.0, "1", "noise in steps of quantisation, above which equal readings in a row are no chance"
    )
    flat_samples: int = number(3, "1", "samples of a flat top, below which it may be chance")
    flat_noise: float = number(8.0, "1", "width of a flat top in noise of the channel")
    flat_steps: float = number(2.5, "1", "width of a flat top in steps of quantisation")
    flat_height: float = number(5.0, "1", "least height of a peak, in widths of its flat top")
    level_noise: float = number(
        1.5, "1", "scatter on a flat top in noise of the channel", "a slow crest scatters more"
    )
    flat_excess: float = number(4.0, "1", "least that was cut off, in widths of the flat top")
    flat_share: float = number(0.02, "1", "least that was cut off, as a share of the peak")

    def slower(self, factor: float) -> Records:
        """The same for a structure so many times slower than those that the times are given for."""
        times = [name for name, _, unit, *_ in self.rows() if unit == "s"]
        slow = {name: factor * getattr(self, name) for name in times}
        return replace(self, lowest_hz=self.lowest_hz / factor, **slow)
