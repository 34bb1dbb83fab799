"""What the figures are made with: bands, ledgers, crossings, and the refusal of other runs."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from cfjax.errors import InputError
from cfjax.report.run_folder import write_run
from experiments.figures.figure import Setting, certified
from experiments.figures.robustness import COLOURS, PANELS, Condition, Ledger, band
from experiments.figures.straight import passing, settled


def test_bands_are_wilsons() -> None:
    for success, cars in ((0, 1000), (7, 200), (500, 1000), (1000, 1000)):
        wanted = binomtest(success, cars).proportion_ci(method="wilson")
        np.testing.assert_allclose(band(success, cars), wanted, atol=1e-4)


def test_a_ledger_remembers(tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    Ledger(file, ("name", "delay")).add(name="pf", delay=0.04, success=12)
    Ledger(file, ("name", "delay")).add(name="tt", delay=0.04, success=7)
    found = Ledger(file, ("name", "delay")).find(name="tt", delay=0.04)
    assert found is not None and found["success"] == "7"
    assert Ledger(file, ("name", "delay")).find(name="tt", delay=0.08) is None


def test_crossing_and_settling() -> None:
    clock, x = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 2.0, 4.0, 6.0])
    assert passing(clock, x, 3.0) == pytest.approx(1.5)
    assert passing(clock, x, -1.0) == 0.0
    assert np.isnan(passing(clock, x, 7.0))
    assert settled(x, np.array([1.0, 0.01, -0.5, 0.01]), 0.1) == 4.0
    assert settled(x, np.zeros(4), 0.1) == 0.0


def test_every_panel_begins_with_the_nominal_car() -> None:
    for _, conditions in PANELS.values():
        assert conditions[0] == Condition()
    assert set(COLOURS) == {"pf", "tt", "pure pursuit", "Stanley", "MPC"}


def test_a_run_that_is_not_certified_is_refused(tmp_path: Path, hand_made) -> None:
    from cfjax.conf import preset, problem_of, yaml_of

    config = preset("circle", ["method=pf", "template=paper"])
    write_run(hand_made(problem_of(config), "paper"), tmp_path / "circle-paper-pf", yaml_of(config))
    setting = Setting(tmp_path, tmp_path, "paper", "sontag", 10, 10, 0)
    with pytest.raises(InputError, match="expected a certified run, this one is inconclusive"):
        certified(setting, "circle", "pf")
