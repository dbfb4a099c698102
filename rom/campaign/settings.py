"""Settings of a campaign: the keys of `campaign.toml`, and what each may be."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal, TypeAlias, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rom.campaign.channels import LARGEST, SMALLEST

Test: TypeAlias = Literal["uncoupled", "coupled", "loosening", "free", "driven", "cycled", "hold"]
LinkLaw: TypeAlias = Literal["linear", "dashpot", "bolted"]
FORMAT = "boltlaw-campaign/1"
GROUND = "ground"
USUAL_WINDOWS = {"initial_s": (0.0, 0.4), "final_s": (2.0, 8.0)}
RECORD_ENDINGS = (".h5", ".mat", ".csv")
MODAL_TESTS = ("free", "driven")
_MOST_MODES = 100  # more are refused by their key

_Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
_Positive: TypeAlias = Annotated[_Number, Field(ge=SMALLEST)]
_NotNegative: TypeAlias = Annotated[_Number, Field(ge=0)]
_Name: TypeAlias = Annotated[str, Field(pattern=r'^[^\s/,"](?:[^/,"\r\n]*[^\s/,"])?$')]
_Window: TypeAlias = tuple[_NotNegative, _NotNegative]

_NAME = "a name (text without slash, comma or quote)"
POSITIVE = f"a number above 0, from {SMALLEST:g} to {LARGEST:g}"
_NOT_NEGATIVE = f"a number of 0 or more, at most {LARGEST:g}"
_WINDOW = "[start, end] in seconds from the record's start, both 0 or more"


def _quoted(choices: Iterable[str]) -> str:
    return "one of " + ", ".join(f'"{choice}"' for choice in choices)


class _Settings(BaseModel):
    """Keys that are not fields are refused; settings never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class BodySettings(_Settings):
    """A lumped mass; `mass_kg` [kg] is None where it is to be identified."""

    name: _Name = Field(description=_NAME)
    mass_kg: _Positive | None = Field(None, description=POSITIVE)


class LinkSettings(_Settings):
    """A spring and damper between two bodies; the optional values [N/m, N s/m] are starting values."""

    name: _Name = Field(description=_NAME)
    between: tuple[str, str] = Field(description='two names, of bodies or "ground"')
    law: LinkLaw = Field(description=_quoted(get_args(LinkLaw)))
    stiffness_n_per_m: _NotNegative | None = Field(None, description=_NOT_NEGATIVE)
    damping_ns_per_m: _NotNegative | None = Field(None, description=_NOT_NEGATIVE)


class BoltSettings(_Settings):
    """The bolt of a bolted link; `calibration` c1, c2, ... gives T = c1 e + c2 e^2 + ... [N] from strain."""

    link: str = Field(description="the name of a bolted link")
    calibration: Annotated[tuple[_Number, ...], Field(min_length=1)] | None = Field(
        None, description="a list of finite coefficients c1, c2, ..."
    )


class SamplingSettings(_Settings):
    """Default rates [Hz] of force and motion, strain and tension; `pretrigger_s` [s] precedes the impact."""

    motion_rate_hz: _Positive = Field(description=POSITIVE)
    tension_rate_hz: _Positive = Field(description=POSITIVE)
    pretrigger_s: _NotNegative = Field(description=_NOT_NEGATIVE)


class WindowSettings(_Settings):
    """Where initial and final tension are averaged: [start, end] [s] from the record's start."""

    initial_s: _Window = Field(description=_WINDOW)
    final_s: _Window = Field(description=_WINDOW)


class BandSettings(_Settings):
    """The band [Hz] in which measured and simulated motion are compared."""

    low_hz: _NotNegative = Field(0.0, description=_NOT_NEGATIVE)
    high_hz: _Positive = Field(description=POSITIVE)


class ModesSettings(_Settings):
    """Modal bodies in place of lumped ones: their number; mode shapes at the sensors are identified."""

    count: Annotated[int, Field(strict=True, ge=1, le=_MOST_MODES)] = Field(
        description=f"a whole number from 1 to {_MOST_MODES}"
    )


class RecordSettings(_Settings):
    """One test: its file in the campaign folder, its kind, the bodies that move, its nominal preload [N].

    `mass_kg` by body and `stiffness_n_per_m` by linear link stand for the campaign's values in this record.
    """

    file: str = Field(description="the path of a record inside the campaign folder")
    test: Test = Field(description=_quoted(get_args(Test)))
    bodies: tuple[str, ...] | None = Field(None, description="a list of body names")
    preload_n: _NotNegative | None = Field(None, description=_NOT_NEGATIVE)
    hold_out: bool = Field(False, strict=True, description="true or false")
    mass_kg: dict[str, _Positive] | None = Field(None, description="a table of bodies and masses")
    stiffness_n_per_m: dict[str, _Positive] | None = Field(
        None, description="a table of linear links and stiffnesses"
    )

    def __hash__(self) -> int:
        return hash((self.file, self.test, self.hold_out))

    @property
    def given(self) -> dict[str, float]:
        """Values of this record alone, in place of the campaign's, by path of a model's parameter."""
        masses = {f"body.{body}.mass": value for body, value in (self.mass_kg or {}).items()}
        stiffnesses = (self.stiffness_n_per_m or {}).items()
        return masses | {f"{link}.stiffness.k": value for link, value in stiffnesses}


class CampaignSettings(_Settings):
    """All of `campaign.toml`, under its own names."""

    format: Literal["boltlaw-campaign/1"] = Field(description=f'"{FORMAT}"')
    name: Annotated[str, Field(min_length=1)] = Field(description="text: the campaign's name")
    body: Annotated[tuple[BodySettings, ...], Field(min_length=1)] = Field(description="one [[body]] or more")
    link: Annotated[tuple[LinkSettings, ...], Field(min_length=1)] = Field(description="one [[link]] or more")
    bolt: BoltSettings | None = Field(None, description="a table [bolt]")
    sampling: SamplingSettings = Field(description="a table [sampling]")
    windows: WindowSettings = Field(description="a table [windows]")
    band: BandSettings | None = Field(None, description="a table [band]")
    modes: ModesSettings | None = Field(None, description="a table [modes]")
    record: Annotated[tuple[RecordSettings, ...], Field(min_length=1)] = Field(
        description="one [[record]] or more"
    )

    @model_validator(mode="before")
    @classmethod
    def _only_what_is_needed(cls, data: Any) -> Any:
        """Fill in what a campaign without a bolt, or one of bolts at rest alone, has no use for."""
        if not isinstance(data, dict):
            return data
        if "modes" in data:
            data = _with_modal_bodies(data)
        if _only_rests(data.get("record")):
            return _at_rest(data)
        return data if "bolt" in data else _without_bolt(data)

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing moves in any record: bolts watched at rest."""
        return all(record.test == "hold" for record in self.record)

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """The declared band [Hz], from and to; None without one."""
        return None if self.band is None else (self.band.low_hz, self.band.high_hz)

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies, in the file's order; "ground" is not among them."""
        return tuple(body.name for body in self.body)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links, in the file's order."""
        return tuple(link.name for link in self.link)

    def with_values_of_all_records(self) -> CampaignSettings:
        """The same with the first of the values that every training record gives and the campaign does not.

        Nothing is left to identify there, and a model needs some value.
        """
        training = [record for record in self.record if not record.hold_out] or list(self.record)

        def first(path: str, ends: Iterable[str]) -> float | None:
            moving = [r for r in training if r.test not in ("cycled", "hold")
                      and set(ends) & set(r.bodies or self.body_names)]  # fmt: skip
            every = [record.given.get(path) for record in moving]
            return every[0] if every and None not in every else None

        bodies, links = [], []
        for body in self.body:
            mass = first(f"body.{body.name}.mass", [body.name]) if body.mass_kg is None else None
            bodies.append(body if mass is None else body.model_copy(update={"mass_kg": mass}))
        for link in self.link:
            k = first(f"{link.name}.stiffness.k", link.between) if link.stiffness_n_per_m is None else None
            links.append(link if k is None else link.model_copy(update={"stiffness_n_per_m": k}))
        return self.model_copy(update={"body": tuple(bodies), "link": tuple(links)})


def modal_structure(count: int) -> dict[str, Any]:
    """Bodies and links of a campaign of some modes: each mode by itself on the ground."""
    names = [f"mode_{place}" for place in range(1, count + 1)]
    links = [{"name": name, "between": (name, GROUND), "law": "linear"} for name in names]
    return {"body": [{"name": name} for name in names], "link": links}


def _with_modal_bodies(data: dict[str, Any]) -> dict[str, Any]:
    """Fill in a body and a link for every mode; what stands there is told of later."""
    modes = data["modes"]
    count = modes.get("count") if isinstance(modes, dict) else None
    sound = isinstance(count, int) and not isinstance(count, bool) and 1 <= count <= _MOST_MODES
    return {**modal_structure(count if isinstance(count, int) and sound else 1), **data}


def _only_rests(records: Any) -> bool:
    rest = [isinstance(record, dict) and record.get("test") == "hold" for record in _sequence(records)]
    return bool(rest) and all(rest)


def _sequence(value: Any) -> tuple[Any, ...]:
    return tuple(value) if isinstance(value, list | tuple) else ()


def _without_bolt(data: dict[str, Any]) -> dict[str, Any]:
    """Windows average a tension: without a bolt they may be left out, and so may its rate."""
    sampling = data.get("sampling")
    if isinstance(sampling, dict) and "motion_rate_hz" in sampling:
        data = {**data, "sampling": {"tension_rate_hz": sampling["motion_rate_hz"], **sampling}}
    return {"windows": USUAL_WINDOWS, **data}


def _at_rest(data: dict[str, Any]) -> dict[str, Any]:
    """Where nothing moves there may be no body, no rate of a motion, no hit, and no windows beside it."""
    sampling = data.get("sampling")
    if isinstance(sampling, dict) and "tension_rate_hz" in sampling:
        rate = sampling["tension_rate_hz"]
        data = {**data, "sampling": {"motion_rate_hz": rate, "pretrigger_s": 0.0, **sampling}}
    if "link" not in data and not (isinstance(data.get("bolt"), dict) and "link" in data["bolt"]):
        body = {"name": "part"}
        first = next((one for one in _sequence(data.get("body")) if isinstance(one, dict)), body)
        link = {"name": "joint", "between": [first.get("name", "part"), GROUND], "law": "bolted"}
        bolt = data.get("bolt", {})
        named = {**bolt, "link": link["name"]} if isinstance(bolt, dict) else bolt
        data = {"body": [body], **data, "link": [link], "bolt": named}
    return {"windows": USUAL_WINDOWS, **data}
