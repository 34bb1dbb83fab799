"""The field's benchmarks, in short: a region from its numbers to a replayed file."""

import math
from pathlib import Path

import numpy as np
import pytest

from cfcheck import Outcome, check_document, check_file
from cfjax.certificate.writing import dump, with_hash
from experiments.benchmarks import path_tracking
from experiments.benchmarks.region import NotShown, area_below, certificate


AREA = 82.0  # m rad


@pytest.fixture(scope="module")
def document() -> dict:
    shape = path_tracking.candidate(0.5, printed=False, area=AREA, starts=2)
    return certificate(path_tracking.system("0.5", printed=False), shape, 0.9, 0.01)


def test_a_region_of_path_tracking_is_replayed_from_its_file(document: dict, tmp_path: Path) -> None:
    file = tmp_path / "region.json"
    file.write_text(dump(document))
    report = check_file(file)
    assert report.outcome is Outcome.PROVEN
    assert "of deviations d_e, theta_e" in str(report)  # states that are no pose have no known units
    assert 80 <= area_below(document) <= AREA + 1e-3


def test_less_steering_than_the_proof_is_for_is_refused(document: dict) -> None:
    problem = document["problem"]
    inputs = [problem["inputs"][0], {"name": "tan_delta", "lower": "-2/5", "upper": "2/5"}]
    kept = {key: document[key] for key in ("funnels", "legs", "joints", "hints")}
    weaker = with_hash("funnel", {"problem": {**problem, "inputs": inputs}, **kept})
    assert check_document(weaker).outcome is Outcome.BROKEN


def test_the_area_is_that_of_the_ellipse() -> None:
    document = {"funnels": [{"shape": ["1/4", "0", "1/9"]}]}
    assert area_below(document) == pytest.approx(6 * math.pi, abs=1e-3)
    assert area_below(document) <= 6 * math.pi


def test_a_region_that_reaches_the_circles_centre_is_not_shown() -> None:
    with pytest.raises(NotShown, match="pole"):
        certificate(path_tracking.system("0.84", printed=False), np.diag([1 / 121, 1.0]), 0.9, 0.01)
