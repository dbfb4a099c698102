"""A campaign of raw records from the virtual test rig."""

import difflib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from experiments.rig.campaign import Laboratory, Truth, settings
from experiments.rig.plant import Plant
from experiments.rig.rivals import RIVALS
from experiments.rig.schedule import plan
from experiments.rig.sensors import Instruments
from experiments.rig.strength import Influence, draw, influence
from experiments.rig.undeclared import KINDS, Undeclared, undeclared_from_text
from rom.campaign.campaign import write_campaign
from rom.campaign.record import Channel, replacing
from rom.progress import counted

__all__ = [
    "KINDS",
    "Influence",
    "Undeclared",
    "check_options",
    "draw",
    "influence",
    "run",
    "strengths_from_text",
    "truth_path",
    "undeclared_from_text",
]


def run(
    new_dir: str | Path,
    cases: int | None = None,
    noise: float = 1.0,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    *,
    duration_s: float | None = None,
    strengths: tuple[float, ...] = (1.0,),
    scatter: float = 1.0,
    tightening: bool | None = None,
    hold_out_every: int = 5,
    law: str | None = None,
    rate: float = 1.0,
    undeclared: tuple[Undeclared, ...] = (),
    plant: Plant | None = None,
    instruments: Instruments | None = None,
) -> Path:
    """Measure a campaign on the virtual rig; the truth goes beside it, to ``<new_dir>.truth.json``.

    Parameters
    ----------
    new_dir : str or Path
        Folder to create; it must not exist.
    cases : int or None
        Number of preloads from 6 to 3000 N, one coupled and one loosening test each, and two uncoupled tests.
        None: the paper's full scale of 58 coupled, 84 loosening and 2 uncoupled tests.
    noise : float
        Factor on noise, quantisation, drift, floor motion and the oscillating part of the tension; 0: none.
    seed : int
        Same seed, same records, whatever `jobs`.
    jobs : int
        Tests simulated at the same time (the command takes all cores by default).
    progress : callable or None
        Called with (records written, records in all).
    duration_s : float or None
        Length of a record [s]; None: 30.5 at full scale, 8.5 otherwise.
    strengths : tuple of float
        Loosening hits per preload, as shares of 1608.7 N.
    scatter : float
        Factor on the scatter of gamma from test to test; 0: none.
    tightening : bool or None
        Whether tests below 1100 N may tighten and are repeated; None: at full scale only.
    hold_out_every : int
        One in so many preloads is held out, never the extremes; 0 for none.
    law : str or None
        Name of the tension law that the bolt follows (`experiments.rig.rivals`), for a `plant` without one of
        its own; None: that of the paper. It is told in the truth file alone.
    rate : float
        Factor on the rate of that law.
    undeclared : tuple of Undeclared
        Physics and faults of sensors that the campaign does not tell, added to those of `plant`.
    plant, instruments : Plant, Instruments or None
        The rig and its sensors; None: those of the paper.

    Returns
    -------
    Path
        The campaign folder.

    Raises
    ------
    ValueError
        If `new_dir` exists or an option cannot be.
    """
    folder = Path(new_dir)
    check(folder, cases, noise, jobs, duration_s, strengths, scatter, hold_out_every)
    full_scale = cases is None
    standing = (plant or plant_of(law)).at_rate(rate)
    laboratory = Laboratory(
        replace(standing, effects=(*standing.effects, *undeclared)),
        (instruments or Instruments()).scaled(noise),
        duration_s if duration_s is not None else (30.5 if full_scale else 8.5),
    )
    schedule_seed, record_seed = np.random.SeedSequence(seed).spawn(2)
    tighten = full_scale if tightening is None else tightening
    tests = plan(cases, strengths, scatter, tighten, hold_out_every, schedule_seed)
    truths: list[Truth] = []

    measured = laboratory.measure_all(tests, record_seed.spawn(len(tests)), jobs)

    def records() -> Iterator[tuple[str, Mapping[str, Channel]]]:
        for case, channels, truth in counted(measured, len(tests), progress):
            truths.append(truth)
            yield case.file, channels

    declared = settings(
        "two oscillators, lap joint, virtual rig", tests, laboratory.plant, laboratory.instruments
    )
    # A 32-bit float rounds by less than the converter's step; without noise there is no step to hide it.
    write_campaign(folder, declared, records(), precision="float32" if noise > 0.0 else "float64")
    options: Truth = {
        "cases": cases,
        "noise": noise,
        "seed": seed,
        "scatter": scatter,
        "strengths": list(strengths),
        "law": law,
        "rate": rate,
        "tightening": tightening,
        "hold_out_every": hold_out_every,
    }
    write_truth(truth_path(folder), options, laboratory, truths)
    return folder


def check_options(
    *,
    cases: int | None = None,
    noise: float = 1.0,
    scatter: float = 1.0,
    strengths: Sequence[float] = (1.0,),
    law: str | None = None,
    undeclared: Sequence[str] = (),
    influence_percent: Sequence[float] = (),
    bolts: int | None = None,
    between_bolts: float | None = None,
    duration_s: float | None = None,
    hold_out_every: int = 5,
    seed: int = 0,  # noqa: ARG001 - any will do
) -> None:
    """Refuse options that cannot be, effects as text, before there is a folder.

    Parameters
    ----------
    cases, noise, scatter, strengths, law, duration_s, hold_out_every, seed
        As for `run`.
    undeclared : sequence of str
        As for `undeclared_from_text`; without values where their strengths are drawn.
    influence_percent : sequence of float
        Smallest and largest influence of effects that are drawn [%]; empty: none is.
    bolts : int or None
        2 or more, or None for a campaign of one bolt.
    between_bolts : float or None
        Standard deviation of ln rate from bolt to bolt, 0 or more.

    Raises
    ------
    ValueError
        With a line for every demand that is not met.
    """
    check(None, cases, noise, 1, duration_s, tuple(strengths), scatter, hold_out_every)
    plant_of(law)
    for text in undeclared:
        effect = undeclared_from_text(text)
        if influence_percent and effect.parameters != Undeclared(effect.name, effect.enters).parameters:
            raise ValueError(f"undeclared: got values in {text!r}, expected none where strengths are drawn")
    if bolts is not None and bolts < 2:
        raise ValueError(f"bolts: got {bolts}, expected 2 or more")
    if between_bolts is not None and (bolts is None or not 0.0 <= between_bolts < np.inf):
        raise ValueError(f"between_bolts: got {between_bolts}, expected 0 or more, with a number of bolts")
    if bolts is not None and influence_percent:
        raise ValueError("influence_percent: got a range with several bolts, expected it with one")
    if influence_percent and not (
        len(influence_percent) == 2 and 0.0 < influence_percent[0] <= influence_percent[1] < np.inf
    ):
        raise ValueError(
            f"influence_percent: got {list(influence_percent)}, expected a smallest and a largest, above 0"
        )


def plant_of(law: str | None) -> Plant:
    """Return the rig whose bolt follows a law by name; None: that of the paper.

    Raises
    ------
    ValueError
        If no law has the name.
    """
    if law is None:
        return Plant()
    if law not in RIVALS:
        near = difflib.get_close_matches(law, RIVALS, 1)
        hint = f"; the nearest is {near[0]}" if near else ""
        raise ValueError(f"law: got {law!r}, expected one of {', '.join(RIVALS)}{hint}")
    return Plant(loosening=RIVALS[law])


def strengths_from_text(text: str) -> tuple[float, ...]:
    """Return the shares in a list such as "1,0.8,0.6".

    Raises
    ------
    ValueError
        If it is no list of numbers.
    """
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"strengths: got {text!r}, expected shares such as 1,0.8,0.6") from None


def truth_path(folder: Path) -> Path:
    """Where the truth of a campaign lies: beside its folder."""
    return folder.with_name(folder.name + ".truth.json")


def write_truth(path: Path, options: Truth, laboratory: Laboratory, truths: list[Truth]) -> None:
    """Write all that was hidden from the campaign, at once or not at all.

    Parameters
    ----------
    path : Path
        The file.
    options : dict
        What the campaign was asked for with.
    laboratory : Laboratory
        Rig, instruments and duration.
    truths : list of dict
        Of every record.
    """
    plant = {
        key: value for key, value in vars(laboratory.plant).items() if key not in ("loosening", "effects")
    }
    plant["loosening"] = [asdict(term) for term in laboratory.plant.loosening]
    content = {
        "format": "boltlaw-truth/1",
        **options,
        "duration_s": laboratory.duration,
        "undeclared": [
            effect.truth() | {"influence_percent": asdict(influence(effect, laboratory.plant))}
            for effect in laboratory.plant.effects
        ],
        "plant": plant,
        "instruments": asdict(laboratory.instruments),
        "records": truths,
    }
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def check(
    folder: Path | None,
    cases: int | None,
    noise: float,
    jobs: int,
    duration_s: float | None,
    strengths: tuple[float, ...],
    scatter: float,
    hold_out_every: int,
) -> None:
    """Refuse what cannot be, before anything is computed.

    Parameters
    ----------
    folder : Path or None
        Must not exist.
    cases : int or None
        Preloads, at least 2; None: the paper's.
    noise, scatter : float
        Factors of 0 or more.
    jobs : int
        1 or more.
    duration_s : float or None
        Length of a record, at least 2.5 s.
    strengths : tuple of float
        Shares of the full hit, above 0.
    hold_out_every : int
        0 or more.

    Raises
    ------
    ValueError
        With a line for every demand that is not met.
    """
    demands = [
        (
            folder is None or not folder.exists(),
            f"{folder}: exists already; a campaign is written to a new folder, name another one",
        ),
        (cases is None or cases >= 2, f"cases: got {cases}, expected at least 2 preloads"),
        (0.0 <= noise < np.inf, f"noise: got {noise}, expected a factor of 0 or more"),
        (jobs >= 1, f"jobs: got {jobs}, expected 1 or more"),
        (
            duration_s is None or 2.5 <= duration_s < np.inf,
            f"duration_s: got {duration_s}, expected 2.5 s or more",
        ),
        (
            bool(strengths) and all(0.0 < share < np.inf for share in strengths),
            f"strengths: got {strengths}, expected shares > 0",
        ),
        (0.0 <= scatter < np.inf, f"scatter: got {scatter}, expected a factor of 0 or more"),
        (hold_out_every >= 0, f"hold_out_every: got {hold_out_every}, expected 0 (none) or more"),
    ]
    faults = [message for met, message in demands if not met]
    if faults:
        raise ValueError("\n".join(faults))
