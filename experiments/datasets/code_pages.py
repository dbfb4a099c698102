"""Texts of a file in a code page that it does not name: the names of the map tell which."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from experiments.datasets.signals import Signal

TAKEN = "cp1252"  # for any text that is no UTF
PAGES = ("cp1251", "mac_roman", "cp1250", "mac_cyrillic", "koi8_r", "cp1253", "cp1254", "cp850", "cp866")


def in_code_page(signals: Sequence[Signal], names: Collection[str]) -> tuple[list[Signal], str]:
    """Return signals with names and units in the code page in which the file has names of the map.

    Parameters
    ----------
    signals : sequence of Signal
        As read, names not in UTF taken for Windows' Latin code page.
    names : collection of str
        Signals that the map asks for.

    Returns
    -------
    tuple of (list of Signal, str)
        The signals, as they came where the map asks for none in another code page, and its name, or "".
    """
    there = {signal.name for signal in signals}
    for page in PAGES:
        misread = {_misread(name, page): name for name in names if name not in there and not name.isascii()}
        if there & (misread.keys() - {""}):
            renamed = (misread.get(signal.name) or _reread(signal.name, page) for signal in signals)
            return [
                replace(signal, name=name, unit=_reread(signal.unit, page))
                for signal, name in zip(signals, renamed, strict=True)
            ], page
    return list(signals), ""


def _misread(text: str, page: str) -> str:
    """Return how a text of a code page looks when taken for the Latin one; "" if it has no such text."""
    try:
        return text.encode(page).decode(TAKEN, errors="replace")
    except UnicodeEncodeError:
        return ""


def _reread(text: str, page: str) -> str:
    try:
        return text.encode(TAKEN).decode(page)
    except UnicodeError:
        return text
