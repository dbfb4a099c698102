"""Errors of a model over a campaign: every record streamed, simulated and compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from joblib import Parallel, delayed

from rom.campaign.campaign import Campaign, RecordSettings
from rom.evaluation.error_measures import Comparison, compare_all
from rom.model.laws import no_loosening
from rom.model.model import Model
from rom.one_thread import one_threaded
from rom.progress import Progress, counted
from rom.signals.filters import compile_filters
from rom.signals.measured_records import measured_record
from rom.signals.quality import Doubt

Bands = Literal["none", "hold_out", "all"]


@dataclass(frozen=True)
class Evaluation:
    """One record and what each model made of it; nothing where the record was set aside."""

    settings: RecordSettings
    comparisons: tuple[Comparison, ...]
    doubts: tuple[Doubt, ...] = ()


@one_threaded
def evaluate(
    models: Sequence[Model],
    campaign: Campaign,
    records: Sequence[RecordSettings] | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
    bands: Bands = "none",
) -> tuple[Evaluation, ...]:
    """Compare models with records (None: all) of a campaign, over `jobs` processes; numbers do not depend on
    `jobs`.

    Parameters
    ----------
    models : sequence of Model
        The models.
    campaign : Campaign
        The campaign.
    records : sequence of RecordSettings
        Settings of the records; None for all.
    jobs : int
        Number of processes; numbers do not depend on it.
    progress : callable
        Called with the number of records done and their total.
    bands : {"none", "hold_out", "all"}
        Of which records to simulate the bands of the first model's tension too.

    Returns
    -------
    tuple
        One for each record, in order.
    """
    chosen = campaign.settings.record if records is None else tuple(records)
    bare = [replace(model, identification=None) for model in models]
    if jobs > 1:
        compile_filters()
    tasks = (delayed(_judge_record)(bare, campaign, record, bands) for record in chosen)
    results = Parallel(n_jobs=jobs, return_as="generator", pre_dispatch="2*n_jobs")(tasks)
    return tuple(counted(results, len(chosen), progress))


def without_loosening(model: Model) -> Model:
    """Return the model with dT/dt = 0 in every bolted link, and no change of that: what any law must beat."""
    laws = {
        name: replace(laws, tension_rate=no_loosening() if laws.tension_rate is not None else None)
        for name, laws in model.link_laws.items()
    }
    return replace(model.without_effects_of("law change"), link_laws=laws)


def _judge_record(
    models: Sequence[Model], campaign: Campaign, settings: RecordSettings, bands: Bands
) -> Evaluation:
    found = measured_record(campaign, settings)
    if found.doubts:
        return Evaluation(settings, (), found.doubts)
    measurement = found.measurement.with_cutoff(models[0].filter_cutoff_hz)
    banded = bands == "all" or (bands == "hold_out" and settings.hold_out)
    return Evaluation(settings, compare_all(models, measurement, campaign.settings.windows, banded))
