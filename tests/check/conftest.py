"""A certificate that is proven, as the checker reads it."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cfjax.certificate import certify, dump
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Box, Interval, Method, Problem, ball, circle, tube
from tests.check.courses import lap_document


CANDIDATES = json.loads((Path(__file__).parents[1] / "certificate" / "candidates.json").read_text())


def build(method: str, template: str) -> str:
    entry = CANDIDATES[f"circle {method} {template}"]
    problem = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)), method=Method(method))
    funnel = Funnel(
        template_named(template), np.array(entry["shape"]), entry["rate"], problem.path.segments[0].duration
    )
    document = certify(problem, [funnel], workers=2).document
    assert document is not None
    return dump(document)


@pytest.fixture(scope="session")
def paper_text() -> str:
    """certificate.json of a circle, trajectory tracking, template `paper`: four cells."""
    return build("tt", "paper")


@pytest.fixture(scope="session")
def contracting_text() -> str:
    """The same, template `contracting`: eight cells on two pieces."""
    return build("tt", "contracting")


@pytest.fixture(scope="session")
def tube_text() -> str:
    """Every path with |κ| ≤ 1.5 1/m, 1 ≤ v ≤ 2 m/s, |a| ≤ 0.5 m/s², trajectory tracking: four references."""
    shape = np.array([[23.16, -11.77, 0, 0], [-11.77, 36.3, 0, 0], [0, 0, 36.96, 12.5], [0, 0, 12.5, 23.47]])
    problem = Problem(tube(1.5, Interval(1.0, 2.0), 0.5), inlet=ball(0.15), goal=ball(0.25), method=Method.TT)
    document = certify(problem, [Funnel(template_named("contracting"), shape, 0.0, math.inf)], workers=2).document
    assert document is not None
    return dump(document)


@pytest.fixture(scope="session")
def lap_text() -> str:
    """A lap of two kinds of segments with obstacles, trajectory tracking: one stretch and three, 24 cells."""
    return dump(lap_document())


@pytest.fixture
def certificate(paper_text: str) -> dict[str, Any]:
    """A fresh copy to be spoiled."""
    return json.loads(paper_text)
