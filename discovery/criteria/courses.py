"""Fits of laws to tension histories of many tests."""

from __future__ import annotations

from dataclasses import dataclass

from discovery.criteria.number import Group


@dataclass(frozen=True)
class Courses(Group):
    """Fits of laws to tension histories of many tests."""
