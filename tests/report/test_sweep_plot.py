"""The picture of a sweep: lines over one key of numbers, a map over two, nothing where no number was varied."""

from pathlib import Path

import polars as pl
import pytest

from cfjax.report.sweep_plot import _is_grid, _map, save_sweep_picture
from cfjax.report.table import SWEPT
from cfjax.rounded import margin_text


SPEED, SHELL, METHOD = (SWEPT + key for key in ("path.speed", "beta_lower", "method"))


def table(shells: tuple[str, ...] = ("0.7", "0.8", "0.9")) -> pl.DataFrame:
    """Three speeds, some levels, both methods; the narrowest shell proves nothing at the lowest speed."""
    return pl.DataFrame(
        [
            {
                METHOD: method,
                SHELL: shell,
                SPEED: speed,
                "certified": None if (shell, speed) == ("0.9", "0.5") else 1.23456 * float(speed) * float(shell),
                "falsified": 2.0,
            }
            for method in ("pf", "tt")
            for shell in shells
            for speed in ("0.5", "1.0", "10.0")
        ]
    )


def test_two_keys_of_numbers_span_a_map_for_each_method() -> None:
    figure = _map(table(), SPEED, SHELL, [METHOD])
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left") for axes in panels] == ["pf", "tt"]
    assert [tick.get_text() for tick in panels[0].get_yticklabels()] == ["0.7", "0.8", "0.9"]
    for axes in panels:
        told = {(round(text.get_position()[0]), round(text.get_position()[1])): text.get_text() for text in axes.texts}
        assert told[0, 2] == "none"  # the lowest speed, the narrowest shell
        assert told[2, 0] == margin_text(1.23456 * 10 * 0.7)
        assert len(told) == 9
        assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0.5", "1", "10"]


@pytest.mark.parametrize(
    ("found", "grid"),
    [
        (table(), True),
        (table(("0.7", "0.9")), False),  # two lines say it better
        (table().filter((pl.col(SPEED) == "1.0") | (pl.col(SHELL) == "0.8")), True),
        (table().filter(pl.col(SPEED).is_in(["0.5", "1.0"]) | (pl.col(SHELL) == "0.8")), True),
        (table().filter((pl.col(SPEED) == "1.0") == (pl.col(SHELL) == "0.8")).filter(pl.col(SPEED) != "10.0"), False),
    ],
)
def test_a_map_is_of_pairs_that_were_run(found: pl.DataFrame, grid: bool) -> None:
    assert _is_grid(found, SPEED, SHELL) is grid


@pytest.mark.parametrize("shells", [("0.7", "0.8", "0.9"), ("0.7", "0.9")])
def test_the_picture_is_whole_or_not_there(tmp_path: Path, shells: tuple[str, ...]) -> None:
    assert save_sweep_picture(table(shells), tmp_path) == tmp_path / "margin.png"
    assert [file.name for file in tmp_path.iterdir()] == ["margin.png"]
    assert (tmp_path / "margin.png").read_bytes().startswith(b"\x89PNG")


def test_without_a_number_there_is_no_picture(tmp_path: Path) -> None:
    assert save_sweep_picture(table().select(METHOD, "certified", "falsified"), tmp_path) is None
    assert not list(tmp_path.iterdir())
