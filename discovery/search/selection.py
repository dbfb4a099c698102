"""Which libraries and optimizers a search uses: ours by name, pysindy's as objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from discovery.search.libraries import LIBRARIES
from discovery.search.optimizers import OPTIMIZERS, Path, path_of
from discovery.search.pysindy_libraries import expressions


@dataclass(frozen=True)
class Selection:
    """What a search tries.

    Attributes
    ----------
    families : tuple of str or None
        Names in `LIBRARIES`; all where it is None, none of them where it is empty.
    own : mapping of str to object
        pysindy libraries by the name that they have in sources.
    optimizers : mapping of str to callable or None
        As `OPTIMIZERS`; all of these, and the best pairs of columns, where it is None.
    """

    families: tuple[str, ...] | None = None
    own: Mapping[str, Any] = field(default_factory=dict)
    optimizers: Mapping[str, Path] | None = None


EVERYTHING = Selection()


def select(
    libraries: Sequence[str | object] | None = None, optimizers: Sequence[str | object] | None = None
) -> Selection:
    """Return what names and objects stand for.

    Parameters
    ----------
    libraries : sequence of str or object
        Names in `LIBRARIES`, objects with ``fit``, ``transform`` and ``get_feature_names``; all of
        `LIBRARIES` if not given.
    optimizers : sequence of str or object
        Names in `OPTIMIZERS`, objects with ``fit(theta, target)`` and then ``coef_``; all of `OPTIMIZERS` if
        not given.

    Raises
    ------
    ValueError
        If a name is not known, an object is neither, the name of a column cannot be read, or a list is empty.
    """
    families, own = None, {}
    if libraries is not None:
        asks = ("fit", "transform", "get_feature_names")
        chosen = _by_name("library", libraries, LIBRARIES, asks)
        families = tuple(name for name, value in chosen.items() if value is LIBRARIES.get(name))
        own = {name: value for name, value in chosen.items() if name not in families}
        for name, library in own.items():
            expressions(library, name)  # before a campaign is identified for nothing
    if optimizers is None:
        return Selection(families, own)
    chosen = _by_name("optimizer", optimizers, OPTIMIZERS, ("fit",))
    known = {name: value is OPTIMIZERS.get(name) for name, value in chosen.items()}
    return Selection(families, own, {n: v if known[n] else path_of(v) for n, v in chosen.items()})


def _by_name(
    kind: str, given: Sequence[str | object], known: Mapping[str, Any], asks: Sequence[str]
) -> dict[str, Any]:
    """Return names with what they stand for; objects by their class, numbered where one is there twice."""
    if isinstance(given, str) or not given:
        raise ValueError(f"{kind}: found {given!r}, expected a list of one or more")
    found: dict[str, Any] = {}
    for one in given:
        if isinstance(one, str):
            if one not in known:
                raise ValueError(f"{kind}: found {one!r}, expected one of: {'; '.join(known)}")
            found[one] = known[one]
            continue
        if isinstance(one, type) or not all(hasattr(one, name) for name in asks):
            shown = f"the class {one.__name__}" if isinstance(one, type) else repr(one)
            raise ValueError(f"{kind}: found {shown}, expected a name or an object with {', '.join(asks)}")
        name, count = type(one).__name__, 1
        while name in found or name in given:
            count += 1
            name = f"{type(one).__name__} {count}"
        found[name] = one
    return found
