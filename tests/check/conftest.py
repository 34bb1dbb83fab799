"""A certificate that is proven, as the checker reads it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cfjax.certificate import certify, dump
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Box, Method, Problem, circle


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


@pytest.fixture
def certificate(paper_text: str) -> dict[str, Any]:
    """A fresh copy to be spoiled."""
    return json.loads(paper_text)
