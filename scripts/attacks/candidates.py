"""Funnels that are spoiled before they are proven: what the certifier then certifies has to be true."""

import json
import random
import time
from typing import Any

from attacks.document import Document
from attacks.funnels import failing_funnel, funnel_changed
from attacks.margins import TUBE, is_bounds, number, shape_of
from attacks.problems import path_changed, sets_changed
from attacks.truth import is_true, segment_of


def is_steady(document: Document) -> bool:
    """Whether it is about a tube or one piece of constant turning rate and speed: a problem that is soon made again."""
    path = document["problem"]["path"]
    return is_bounds(path) or (len(path["pieces"]) == 1 and not document["problem"]["sets"]["obstacles"])


def attack_candidate(index: int, seed: int, bases: list[str]) -> dict[str, Any]:
    """A funnel spoiled before it is proven: what the certifier then certifies has to be true."""
    from cfjax.certificate import certify  # with JAX and a solver, which nothing else here needs
    from cfjax.funnel import Funnel, template_named
    from cfjax.problem import (
        Box,
        Ellipsoid,
        Interval,
        KinematicBicycle,
        Method,
        Path,
        Pose,
        Problem,
        Profile,
        Segment,
        Tube,
    )

    rng = random.Random(f"{seed}:candidate:{index}")
    document = json.loads(rng.choice([base for base in bases if is_steady(json.loads(base))]))
    spoil = rng.choice([failing_funnel, funnel_changed, sets_changed, path_changed])
    spoiled = spoil(rng, document)
    question, entry, segment = spoiled["problem"], spoiled["funnels"][0], segment_of(spoiled)
    sets = question["sets"]
    outcome: dict[str, Any] = {"index": f"candidate {index}", "attack": "candidate"}
    started = time.perf_counter()
    try:
        if is_bounds(segment):
            steady = Tube(*(Interval(*map(number, segment[name])) for name in TUBE))
        else:
            constants = (segment[0][name][0] for name in ("turn_rate", "speed"))
            omega, speed = (Profile.constant(number(value), number(segment[0]["duration"])) for value in constants)
            steady = Segment(omega, speed, Pose(0.0, 0.0, 0.0))
        problem = Problem(
            path=Path(question["path"]["name"], (steady,)),
            inlet=Ellipsoid(tuple(number(a) for a in sets["inlet"]["half_axes"])),
            goal=Ellipsoid(tuple(number(a) for a in sets["goal"]["half_axes"])),
            safe=Box(tuple(number(a) for a in sets["safe"]["half_widths"])) if sets["safe"] else None,
            vehicle=KinematicBicycle(**{k: number(v) for k, v in question["vehicle"]["parameters"].items()}),
            method=Method(question["method"]),
        )
        shape = shape_of(entry)
        rate, *levels = (number(entry[name]) for name in ("rate", "beta_lower", "beta_inner"))
        funnel = Funnel(template_named(entry["template"]), shape, rate, steady.duration, *levels)
        found = certify(problem, [funnel], workers=2)
    except ValueError as error:  # the question itself is refused: sets that exclude each other, C not definite
        return {**outcome, "outcome": "BROKEN", "message": str(error)[:300]}
    outcome |= {"message": f"{spoil.__name__}: {found.verdict.value}: {found.message[:200]}"}
    outcome["solved in"] = round(time.perf_counter() - started, 2)
    if found.document is None:
        return {**outcome, "outcome": "BROKEN"}
    false = is_true(found.document, seed=index)
    return {**outcome, "outcome": f"FALSE {false} CERTIFIED" if false else "true, accepted"}
