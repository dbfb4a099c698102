"""Question, answer and headline numbers of one result file."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Headline:
    """One number to remember: words, value with unit, and the raw value as the file holds it."""

    words: str
    shown: str
    raw: float


@dataclass(frozen=True)
class Answer:
    """Question and answer of one result file; `good` is None where there is nothing to judge."""

    question: str
    verdict: str
    sentences: tuple[str, ...] = ()
    headlines: tuple[Headline, ...] = ()
    good: bool | None = None
