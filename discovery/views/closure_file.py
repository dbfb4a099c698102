"""What closure.json says of a closed loop, but for its header: all that prose, tables and figures show."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from discovery.views.closure_summary import sections
from rom.signals.per_record_parameters import per_record_names

if TYPE_CHECKING:
    from discovery.loop.result import Closure, FoundEffect
    from rom.evaluation.error_measures import Kind
    from rom.model.laws import Parameter

_KINDS: tuple[Kind, ...] = ("training", "hold_out")


def closure_section(closure: Closure) -> dict[str, Any]:
    """Return what closure.json says, but for its header."""
    residual = {"before": closure.residual_before, "after": closure.residual_after}
    changes = closure.criteria.changes
    section: dict[str, Any] = {
        **({"criteria": changes} if changes else {}),
        "verdict": closure.verdict,
        "summary": {},
        "effects": [_effect_row(found) for found in closure.effects],
        "refitted": [{"name": path} | parameter_row(p) for path, p in closure.refitted.items()],
        "steps": [
            {"added": step.added, "errors": {kind: dict(step.errors[kind]) for kind in _KINDS}}
            for step in closure.steps
        ],
        "errors": {
            kind: {"before": dict(closure.before[kind]), "after": dict(closure.after[kind])}
            for kind in _KINDS
        },
        "noise_floor": {kind: dict(floor) for kind, floor in closure.noise_floor.items()},
        "residual": {when: dict(one.as_dict()) for when, one in residual.items()},
        "screened": [
            {"name": s.name, "enters": s.enters, "share": s.share, "strength": s.strength}
            for s in closure.screened
        ],
        "detection_limits": [asdict(limit) for limit in closure.detection_limits],
        "set_aside": list(closure.set_aside),
        "warnings": list(closure.warnings),
    }
    return section | {"summary": sections(section)}


def _effect_row(found: FoundEffect) -> dict[str, Any]:
    own = per_record_names(found.effect)
    return {
        "name": found.effect.name,
        "enters": found.effect.enters,
        "equation": found.effect.equation,
        "parameters": {
            name: parameter_row(p) | ({"of_records": True} if name in own else {})
            for name, p in found.effect.parameters.items()
        },
        "look_alikes": [
            {"name": a.name, "enters": a.enters, "hold_out_cost": a.hold_out_cost, "test": a.test}
            for a in found.look_alikes
        ],
        "at_bound": list(found.at_bound),
        "source": found.source,
        "share": found.share,
        "p_value": found.p_value,
        "p_value_from": found.chance,
        "share_of": found.basis,
        "wins": list(found.wins),
    }


def parameter_row(parameter: Parameter) -> dict[str, Any]:
    """Return a parameter as result files hold it; one that ended at a bound has no limit on that side."""
    low, high = parameter.limits
    row = {"value": parameter.value, "low": low, "high": high, "unit": parameter.unit}
    return row | ({"at_bound": True} if parameter.at_bound else {})
