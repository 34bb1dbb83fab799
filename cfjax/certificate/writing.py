"""certificate.json, written: the counterpart of `cfjax.check.document`."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import Any

from flint import fmpq

from cfjax.check.decrease import Matrix, SteadyDecrease
from cfjax.check.document import FORMAT, VERSION, CellKey, document_hash
from cfjax.check.graph import Graph, Node
from cfjax.check.rational import rational
from cfjax.errors import InputError
from cfjax.problem import Method, Problem, Profile, Segment, Tube, Vehicle


Gram = tuple[int, list[int]]  # exponent and lower triangle, `cfjax.certificate.rounding`


def write_problem(problem: Problem, graph: Graph) -> dict[str, Any]:
    """The question: vehicle, method, input box, path, sets."""
    return {
        "vehicle": {
            "name": problem.vehicle.name,
            "parameters": _parameters(problem.vehicle),
            "states": list(problem.vehicle.state_names),
            "dynamics": {"nodes": [_node(node) for node in graph.nodes], "outputs": list(graph.outputs)},
        },
        "method": "tt" if problem.method is Method.TT else "pf",
        "inputs": [
            {"name": name, "lower": _number(limits.lower), "upper": _number(limits.upper)}
            for name, limits in zip(("u0", *problem.vehicle.input_names), problem.inputs, strict=True)
        ],
        "path": {"name": problem.path.name, "segments": [_segment(segment) for segment in problem.path.segments]},
        "sets": {
            "inlet": {"half_axes": [_number(value) for value in problem.inlet.half_axes]},
            "goal": {"half_axes": [_number(value) for value in problem.goal.half_axes]},
            "safe": {"half_widths": [_number(value) for value in problem.safe.half_widths]} if problem.safe else None,
        },
    }


def write_funnel(
    template: str,
    shape: Matrix,
    rate: fmpq,
    levels: tuple[fmpq, fmpq],
    margin: fmpq,
    margin_per_metre: fmpq | None = None,
) -> dict[str, Any]:
    """One segment's V with the margin that is claimed for it; `levels` are β̲ and β_in."""
    return {
        "template": template,
        "shape": [str(shape[i][j]) for i in range(len(shape)) for j in range(i + 1)],
        "rate": str(rate),
        "beta": "1",
        "beta_lower": str(levels[0]),
        "beta_inner": str(levels[1]),
        "margin": str(margin),
        "margin_per_metre": None if margin_per_metre is None else str(margin_per_metre),
    }


def write_steady_proof(decrease: SteadyDecrease, cells: Sequence[tuple[CellKey, fmpq, Sequence[Gram]]]) -> dict:
    """The hints for condition (d): per cell its reference, level piece, signs, margin and Gram matrices."""
    return {
        "kind": "steady",
        "whitening": [[str(entry) for entry in row] for row in decrease.whitening],
        "degrees": list(decrease.degrees),
        "enclosures": [
            {
                "node": node,
                "function": unary.function,
                "coefficients": [str(c) for c in unary.coefficients],
                "lower": str(unary.lower),
                "upper": str(unary.upper),
                "bound": str(unary.bound),
            }
            for node, unary in decrease.enclosures.items()
        ],
        "cells": [
            {
                "reference": reference,
                "piece": piece,
                "signs": list(signs),
                "margin": str(margin),
                "grams": [{"exponent": exponent, "lower": list(lower)} for exponent, lower in grams],
            }
            for (reference, piece, signs), margin, grams in cells
        ],
    }


def write_witness(condition: str, theta: fmpq, reference: int, x: Sequence[fmpq]) -> dict[str, Any]:
    """Where a candidate violates a condition, and at which of the extreme references."""
    return {"condition": condition, "theta": str(theta), "reference": reference, "x": [str(value) for value in x]}


def seal(claim: str, problem: Mapping[str, Any], funnels: list[dict], last: list[dict] | dict) -> dict[str, Any]:
    """The whole document with its hash; `last` holds the proofs of a funnel or the witness of a refutation."""
    document = {
        "format": FORMAT,
        "version": VERSION,
        "claim": claim,
        "problem": dict(problem),
        "funnels": funnels,
        ("proofs" if claim == "funnel" else "witness"): last,
    }
    return {**document, "hash": document_hash(document)}


def dump(document: Mapping[str, Any]) -> str:
    """The file's text: what lies on disk is what was replayed."""
    return json.dumps(document, separators=(",", ":"), ensure_ascii=True) + "\n"


def _number(value: float) -> str:
    return str(rational(float(value)))


def _parameters(vehicle: Vehicle) -> dict[str, str]:
    fields = dataclasses.fields(vehicle) if dataclasses.is_dataclass(vehicle) else ()
    values = {field.name: getattr(vehicle, field.name) for field in fields}
    return {
        name: _number(value)
        for name, value in values.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def _node(node: Node) -> list:
    if node.value is not None:
        return [node.op, str(node.value)]
    return [node.op, node.name] if node.name is not None else [node.op, *node.args]


def _segment(segment: Segment | Tube) -> dict[str, Any]:
    if isinstance(segment, Tube):
        bounds = {"curvature": segment.curvature, "speed": segment.speed, "acceleration": segment.acceleration}
        return {name: [_number(interval.lower), _number(interval.upper)] for name, interval in bounds.items()}
    return {
        "duration": _number(segment.duration),
        "turn_rate": _profile(segment.turn_rate, segment.duration),
        "speed": _profile(segment.speed, segment.duration),
    }


def _profile(profile: Profile, duration: float) -> dict[str, Any]:
    if not profile.is_constant:
        raise InputError("certificate: expected a segment of constant turning rate and speed, others come later")
    return {"breaks": ["0", _number(duration)], "coefficients": [[_number(profile.coefficients[0][0])]]}
