"""What the figures are made with: bands, ledgers, crossings, and the refusal of other runs."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

import cfjax
from cfjax.errors import InputError
from cfjax.report.run_folder import write_run
from experiments.figures import oval, straight
from experiments.figures.figure import Setting, certified
from experiments.figures.robustness import COLOURS, MARKERS, PANELS, Condition, Ledger, band
from experiments.figures.straight import passing, settled
from tests.report.test_marks import LEAST_DISTANCE, SEEN, oklab


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


def test_no_picture_has_colours_of_its_own() -> None:
    """Greys, and what `cfjax.report.style` has: the house's colours, which colour-blind readers tell apart."""
    root = Path(cfjax.__file__).parents[1]
    files = [file for room in ("experiments", "scripts") for file in (root / room).rglob("*.py")]
    own = {
        (file.name, colour)
        for file in files
        for colour in re.findall(r"""["'](#[0-9a-fA-F]{6}|tab:\w+|red|green|blue|orange)["']""", file.read_text())
    }
    assert len(files) > 40
    assert not {each for each in own if not each[1].startswith("#") or np.ptp(list(bytes.fromhex(each[1][1:]))) > 16}


def test_the_curves_of_a_figure_are_told_apart_without_one_kind_of_cone() -> None:
    groups = (straight.PF_COLOUR, straight.TT_COLOUR), [colour for *_, colour in oval.DRIVES.values()]
    for colours in groups:
        for seen in SEEN.values():
            for one, other in combinations(colours, 2):
                assert np.linalg.norm(oklab(seen, one) - oklab(seen, other)) > LEAST_DISTANCE, (one, other)
    # five curves are too many for that: there each has a symbol too
    assert len(set(COLOURS.values())) == len(set(MARKERS.values())) == len(COLOURS)


def test_a_run_that_is_not_certified_is_refused(tmp_path: Path, hand_made) -> None:
    from cfjax.conf import preset, problem_of, yaml_of

    config = preset("circle", ["method=pf", "template=paper"])
    write_run(hand_made(problem_of(config), "paper"), tmp_path / "circle-paper-pf", yaml_of(config))
    setting = Setting(tmp_path, tmp_path, "paper", "sontag", 10, 10, 0)
    with pytest.raises(InputError, match="expected a certified run, this one is inconclusive"):
        certified(setting, "circle", "pf")
