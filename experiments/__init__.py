"""Runs and shows: commands, virtual rig, figures and reports.

``run_experiment("experiment.toml")`` runs the cells of an experiment's file and returns their table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.studies.experiment.run import run_experiment

__all__ = ["run_experiment"]


def __getattr__(name: str) -> Any:
    """Import the public function when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module 'experiments' has no attribute {name!r}; it has {', '.join(__all__)}")
    from experiments.studies.experiment.run import run_experiment

    return run_experiment
