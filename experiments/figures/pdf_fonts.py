"""Fonts in PDF figures, cut to letters once in a process: matplotlib does so for every figure, which takes
half of the time of a PDF.

It has no option for this. Where another matplotlib has other names nothing is lost but time.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache, partial
from io import BytesIO
from typing import Any

from fontTools.subset import Options
from matplotlib.backends import _backend_pdf_ps as shared
from matplotlib.ft2font import FT2Font

_Cut = Callable[[Any, Collection[int]], AbstractContextManager[Any]]
_LETTERS = (*range(0x20, 0x7F), *map(ord, "°±²³·¹×µ"), *range(0x3B1, 0x3CA), *range(0x2070, 0x208F), 0x2212)
_NO_USE = ["GDEF", "GPOS", "GSUB", "kern"]  # tables for setting text, which take longest to read


class _Letters:
    """A font cut to letters, as matplotlib asks for it: a font that is saved, and places by glyph."""

    def __init__(self, found: Any) -> None:
        file = BytesIO()
        found.font.save(file, reorderTables=False)
        self._file, self.glyph_index_map, self.font = file.getvalue(), dict(found.glyph_index_map), self

    def save(self, file: BytesIO, **_options: Any) -> None:
        """Write the font to a file."""
        file.write(self._file)


@contextmanager
def fonts_cut_once() -> Iterator[None]:
    """Write PDFs whose fonts hold common letters alone, or those of the figure where it has others."""
    before: Any = getattr(shared, "get_glyphs_subset", None)
    tables = getattr(Options, "_drop_tables_default", [])
    Options._drop_tables_default = [*tables, *_NO_USE]
    if hasattr(shared, "SubsetResults"):
        shared.get_glyphs_subset = partial(_cut, before)
    try:
        yield
    finally:
        Options._drop_tables_default = tables
        if before is not None:
            shared.get_glyphs_subset = before


def _cut(cut: _Cut, font: Any, glyphs: Collection[int]) -> AbstractContextManager[Any]:
    """The same letters of every figure, so that a figure does not depend on those before it."""
    letters = _cut_to_letters(cut, font)
    return nullcontext(letters) if letters.glyph_index_map.keys() >= set(glyphs) else cut(font, glyphs)


@cache
def _cut_to_letters(cut: _Cut, font: Any) -> _Letters:
    places = FT2Font(font).get_charmap()
    with cut(font, {places[letter] for letter in _LETTERS if letter in places}) as found:
        return _Letters(found)
