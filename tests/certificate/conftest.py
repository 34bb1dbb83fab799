"""Candidates that a learner found once, so that these tests need not learn; their margins are checked, not believed."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cfjax.funnel import Funnel, template_named
from cfjax.problem import Box, Method, Problem, circle, straight


CANDIDATES = json.loads((Path(__file__).parent / "candidates.json").read_text())


@pytest.fixture(scope="session")
def candidate() -> Callable[..., tuple[Problem, Funnel]]:
    """(path, method, template) ↦ a problem and a funnel that solves it."""

    def make(path: str, method: str, template: str) -> tuple[Problem, Funnel]:
        entry = CANDIDATES[f"{path} {method} {template}"]
        line = {"circle": circle(), "straight": straight(4.0)}[path]
        problem = Problem(line, safe=Box((1.0, 1.0, 1.0, 3.0)), method=Method(method))
        duration = line.segments[0].duration
        return problem, Funnel(template_named(template), np.array(entry["shape"]), entry["rate"], duration)

    return make
