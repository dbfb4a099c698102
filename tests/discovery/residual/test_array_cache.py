"""What was asked for last is held, up to a size."""

from __future__ import annotations

import numpy as np

from discovery.residual.array_cache import ArrayCache


def test_what_was_asked_for_longest_ago_goes_first() -> None:
    held, one = ArrayCache(3 * 80), [np.zeros(10)]
    for key in "abc":
        held.keep(key, one)
    assert held.get("a") is one
    held.keep("d", one)
    assert held.get("b") is None
    assert all(held.get(key) is one for key in "acd")


def test_what_is_kept_twice_counts_once() -> None:
    held = ArrayCache(2 * 80)
    for _ in range(5):
        held.keep("a", [np.zeros(10)])
    held.keep("b", [np.zeros(10)])
    assert held.get("a") is not None


def test_what_is_larger_than_all_room_is_not_held() -> None:
    held = ArrayCache(80)
    held.keep("a", [np.zeros(100)])
    assert held.get("a") is None
