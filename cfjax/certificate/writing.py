"""certificate.json, written: the counterpart of `cfcheck.claims.document`."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from flint import fmpq

from cfcheck.claims.assumptions import closes
from cfcheck.claims.document import CLAIMS, FORMAT, HINTS, VERSION, WITNESS, LegClaim, document_hash
from cfcheck.claims.hints import CellHints, CellKey
from cfcheck.exact.enclosure import UnaryEnclosure
from cfcheck.exact.graph import Graph, Node
from cfcheck.exact.rational import Range, rational
from cfcheck.exact.symbolic import symbolic
from cfcheck.kernel.decrease import SteadyDecrease
from cfcheck.kernel.funnel import FunnelClaim
from cfcheck.kernel.program import Gram
from cfcheck.path.bounds import Bounds
from cfcheck.path.piece import Piece
from cfcheck.vehicle.model import KNOWN_VEHICLES
from cfjax.certificate.trace import trace_law
from cfjax.coerce import instance
from cfjax.exact import exact_bounds, exact_course, exact_surroundings, write_path, write_surroundings
from cfjax.problem import FeedbackLaw, Problem, Vehicle
from cfjax.problem.vehicle import numbers_of


def write_problem(problem: Problem, graph: Graph) -> dict[str, Any]:
    """The question: vehicle, method, input box, path, sets."""
    return {
        "vehicle": write_vehicle(problem.vehicle, graph),
        "method": problem.method.value,
        "inputs": write_inputs(exact_inputs(problem)),
        "path": _path(problem, graph),
        "sets": write_sets(problem),
        **({} if problem.law is None else {"law": write_law(problem.law, trace_law(problem.vehicle, problem.law))}),
    }


def write_law(law: FeedbackLaw, graph: Graph) -> dict[str, Any]:
    """The inputs that a law gives, before they are limited, as a graph."""
    return {"name": law.name, "nodes": [_node(node) for node in graph.nodes], "outputs": list(graph.outputs)}


def exact_inputs(problem: Problem) -> dict[str, Range]:
    """The box by name, u0 first."""
    names = "u0", *problem.vehicle.input_names
    return {
        name: (rational(float(ends.lower)), rational(float(ends.upper)))
        for name, ends in zip(names, problem.inputs, strict=True)
    }


def write_inputs(inputs: Mapping[str, Range]) -> list[dict[str, str]]:
    """A box by name, u0 first."""
    return [{"name": name, "lower": str(lower), "upper": str(upper)} for name, (lower, upper) in inputs.items()]


def write_sets(problem: Problem) -> dict[str, Any]:
    """I, G and S, obstacles and the body."""
    return {
        "inlet": {"half_axes": [_number(value) for value in problem.inlet.half_axes]},
        "goal": {"half_axes": [_number(value) for value in problem.goal.half_axes]} if problem.goal else None,
        "safe": {"half_widths": [_number(value) for value in problem.safe.half_widths]} if problem.safe else None,
        **write_surroundings(exact_surroundings(problem.obstacles, problem.footprint)),
    }


def write_vehicle(vehicle: Vehicle, graph: Graph) -> dict[str, Any]:
    """Name, parameters, states, and the deviation's rate as a graph."""
    return {
        "name": vehicle.name,
        "parameters": {name: str(value) for name, value in exact_parameters(vehicle).items()},
        "states": list(vehicle.state_names),
        "dynamics": {"nodes": [_node(node) for node in graph.nodes], "outputs": list(graph.outputs)},
    }


def write_funnel(funnel: FunnelClaim) -> dict[str, Any]:
    """V with the margins that are claimed for it, of a funnel for the vehicle that drives."""
    return {
        "template": funnel.level.name,
        "shape": [str(funnel.shape[i][j]) for i in range(len(funnel.shape)) for j in range(i + 1)],
        "rate": str(funnel.level.rate),
        "beta": "1",
        "beta_lower": str(funnel.beta_lower),
        "beta_inner": str(funnel.beta_inner),
        "margin": str(funnel.margin),
        "margin_per_metre": None if funnel.margin_per_metre is None else str(funnel.margin_per_metre),
        "model": None,
    }


def write_legs(legs: Sequence[LegClaim]) -> list[dict[str, int]]:
    """Which funnel holds up to which piece of the path."""
    return [{"end": leg.end, "funnel": leg.funnel} for leg in legs]


def write_joints(ratios: Sequence[fmpq]) -> list[dict[str, str]]:
    """How much wider each next funnel is."""
    return [{"ratio": str(ratio)} for ratio in ratios]


def write_decrease(
    degrees: Sequence[int], mirror: Sequence[int] | None, stretches: list[dict], law_degree: int | None = None
) -> dict[str, Any]:
    """The hints for condition (d) of one funnel."""
    of_law = {} if law_degree is None else {"law_degree": law_degree}
    signs = None if mirror is None else list(mirror)
    return {"degrees": list(degrees), "mirror": signs, "stretches": stretches, **of_law}


def write_stretch(
    end: fmpq | None, bounds: Bounds, decrease: SteadyDecrease, cells: Sequence[tuple[CellKey, CellHints]]
) -> dict[str, Any]:
    """The hints on one stretch, cell by cell; without an end it is all that there is of an invariant funnel."""
    return {
        "end": None if end is None else str(end),
        "bounds": write_bounds(bounds),
        "whitening": [[str(entry) for entry in row] for row in decrease.whitening],
        "enclosures": write_unary(decrease.enclosures),
        "cells": [
            {
                "reference": reference,
                "piece": piece,
                "signs": list(signs),
                "margin": str(found.margin),
                "remainder": [str(value) for value in found.remainder],
                "grams": write_grams(found.grams),
            }
            for (reference, piece, signs), found in cells
        ],
    }


def write_unary(enclosures: Mapping[int, UnaryEnclosure]) -> list[dict[str, Any]]:
    """What is said of the functions that nodes of the graph apply."""
    return [
        {
            "node": node,
            "function": unary.function,
            "coefficients": [str(c) for c in unary.coefficients],
            "lower": str(unary.lower),
            "upper": str(unary.upper),
            "bound": str(unary.bound),
        }
        for node, unary in enclosures.items()
    ]


def write_grams(grams: Sequence[Gram]) -> list[dict[str, Any]]:
    """Gram matrices: whole numbers over a power of two."""
    return [{"exponent": gram.exponent, "lower": list(gram.lower)} for gram in grams]


def write_bounds(bounds: Bounds) -> dict[str, Any]:
    """Intervals of curvature, speed and acceleration, and of the curvature's rate where that is bounded."""
    return {name: [str(end) for end in ends] for name, ends in bounds.intervals.items()}


def write_witness(condition: str, leg: int, theta: fmpq, reference: int, x: Sequence[fmpq]) -> dict[str, Any]:
    """Where a candidate violates a condition: on which leg, or at which extreme reference of every path in bounds."""
    return {
        "condition": condition,
        "leg": leg,
        "theta": str(theta),
        "reference": reference,
        "x": [str(value) for value in x],
    }


def seal(
    claim: str,
    problem: Mapping[str, Any],
    funnels: list[dict],
    last: dict,
    legs: Sequence[LegClaim] = (),
    ratios: Sequence[fmpq] = (),
) -> dict[str, Any]:
    """The whole document with its hash; `last` holds the hints for funnels or the witness of a refutation."""
    content = {"funnels": funnels, "legs": write_legs(legs), "joints": write_joints(ratios)}
    return with_hash(claim, {"problem": dict(problem), **content, HINTS if claim == CLAIMS[0] else WITNESS: last})


def with_hash(claim: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """A whole document of this format."""
    document = {"format": FORMAT, "version": VERSION, "claim": claim, **content}
    return {**document, "hash": document_hash(document)}


def dump(document: Mapping[str, Any]) -> str:
    """The file's text: what lies on disk is what was replayed."""
    instance("document", document, Mapping)
    return json.dumps(document, separators=(",", ":"), ensure_ascii=True) + "\n"


def _number(value: float) -> str:
    return str(rational(float(value)))


def exact_parameters(vehicle: Vehicle) -> dict[str, fmpq]:
    """The numbers among its fields."""
    return {
        name: rational(float(value))
        for name, value in numbers_of(vehicle).items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def _node(node: Node) -> list:
    if node.value is not None:
        return [node.op, str(node.value)]
    return [node.op, node.name] if node.name is not None else [node.op, *node.args]


def _closes(problem: Problem, graph: Graph, pieces: Sequence[Piece]) -> bool:
    states, inputs = problem.vehicle.state_names, ("u0", *problem.vehicle.input_names)
    return closes(symbolic(graph, states, inputs), states, pieces)


def _path(problem: Problem, graph: Graph) -> dict[str, Any]:
    path = problem.path
    if path.tube:
        return {"name": path.name, "bounds": write_bounds(exact_bounds(path.tube))}
    pieces = exact_course(path).pieces
    # that one lap leads to the next is proven where it is known what the gap between them does to the states
    closed = path.closed and (problem.vehicle.name in KNOWN_VEHICLES or _closes(problem, graph, pieces))
    return write_path(path, pieces, closed)
