"""Marks: both renderers show the same, in colours that can be told apart, and neither says more than is proven."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
import plotly.graph_objects as go
import pytest
import shapely
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from cfjax.conf import preset, problem_of
from cfjax.report import marks
from cfjax.report.draw import draw, handles
from cfjax.report.marks import Axis, Band, Kind, Lines, Note, Panel, joined, rings_of
from cfjax.report.page.figure import figure_of
from cfjax.report.page.space import space_of
from cfjax.report.panels import shown_of
from cfjax.result import Result, Rollouts, StretchMargin, WorstPlace
from cfjax.verdict import Verdict


Make = Callable[..., Result]  # hand_made
Color = np.ndarray

# linear RGB as readers without one kind of cone see it (Machado, Oliveira, Fernandes 2009)
SEEN = {
    "all cones": np.eye(3),
    "no green ones": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "no red ones": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "no blue ones": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
LEAST_DISTANCE = 0.1  # in Oklab, where black and white are 1 apart; of green and red as they were it was 0.03


def _shown(made: Result) -> Result:
    """Everything at once: cars, a proof in stretches, a place where one failed, worst points."""
    end = sum(segment.duration for segment in made.problem.path.curve)
    theta = np.linspace(0.0, end, 50)[:, None] * np.ones((1, 3))
    x = np.zeros((50, 3, 4)) + 0.05 * np.arange(3)[None, :, None]
    segments = tuple(
        replace(found, margin_certified=0.29999, stretches=(StretchMargin(0.0, found.funnel.duration, 0.29999),))
        for found in made.segments
    )
    return made.replace(
        verdict=Verdict.CERTIFIED,
        segments=segments,
        rollouts=(Rollouts(theta, theta, x, 0.5 * np.exp(-theta), np.ones((50, 3, 3))),),
        failed_at=(0.3, 0.6),
        worst_points=(WorstPlace(0, "d", 0.25, 0.5, (0.1, 0.2, 0.3, 0.1)),),
    )


def _tube(made: Result) -> Result:
    way = np.linspace(0.0, 5.0, 40)[:, None]
    poses = np.stack([0 * way, 0.1 * way**2, way], axis=-1)
    cars = Rollouts(way, way, np.full((40, 1, 4), 0.02), np.full((40, 1), 0.3), np.ones((40, 1, 3)), poses)
    return made.replace(rollouts=(cars,))


@pytest.fixture(params=["circle", "oval", "obstacle", "tube"])
def result(request: pytest.FixtureRequest, hand_made: Make) -> Result:
    made = hand_made(problem_of(preset(request.param)))
    return _tube(made) if made.problem.path.tube else _shown(made)


def test_both_renderers_say_and_show_the_same(result: Result) -> None:
    groups = shown_of(result, 5000).panels
    assert {"plane", "values", "inputs", "sections"} <= set(groups)
    for name, panels in groups.items():
        page = figure_of(name, "", panels, beside=name == "sections")
        legend = [
            (trace["name"], to_hex(trace["marker" if "marker" in trace else "line"]["color"]))
            for trace in page.traces
            if trace["showlegend"]
        ]
        printed = [
            (entry.get_label(), to_hex(entry.get_edgecolor() if hasattr(entry, "get_edgecolor") else entry.get_color()))
            for entry in handles(*panels)
        ]
        assert legend == printed
        for k, panel in enumerate(panels):
            axes = Figure().add_subplot()
            draw(axes, panel)
            number = str(k + 1) if k else ""
            across, up = page.layout[f"xaxis{number}"], page.layout[f"yaxis{number}"]
            assert axes.get_ylabel() == up["title"]["text"] == panel.up.title
            assert across["title"]["text"] in (axes.get_xlabel(), "")
            for axis, ends in ((across, axes.get_xlim()), (up, axes.get_ylim())):
                assert "range" not in axis or axis["range"] == pytest.approx(ends)


def test_what_the_page_is_given_is_what_plotly_takes(result: Result) -> None:
    shown = shown_of(result, 5000)
    figures = [figure_of(name, "", panels, beside=name == "sections") for name, panels in shown.panels.items()]
    space = space_of(result, shown)
    assert space is not None
    for figure in (*figures, space):
        own = ("heights", "spread", "shades")  # for the page's script
        traces = [{key: value for key, value in trace.items() if key not in own} for trace in figure.traces]
        go.Figure(data=traces, layout=figure.layout)  # raises ValueError where it does not know a key or a value


def test_what_lies_on_the_plane_stands_in_space_too(hand_made: Make) -> None:
    result = _shown(hand_made(problem_of(preset("obstacle"))))
    shown = shown_of(result, 5000)
    space = space_of(result, shown)
    assert space is not None
    names = {trace.get("name"): trace for trace in space.traces}
    assert {kind.label for kind in (marks.REFERENCE, marks.START, marks.END, marks.FAILED, marks.WORST)} <= set(names)
    assert names["worst point of (d)"]["heights"]["theta"] == [0.5]
    walls = [trace for trace in space.traces if trace.get("opacity") == 0.3]
    assert len(walls) == len(result.problem.obstacles)


def test_colours_are_told_apart_without_one_kind_of_cone() -> None:
    kinds = (marks.FUNNEL, marks.REFERENCE, marks.CARS, marks.START, marks.END, marks.FAILED)
    for seen in SEEN.values():
        for one, other in combinations(kinds, 2):
            distance = np.linalg.norm(oklab(seen, one.colour) - oklab(seen, other.colour))
            assert distance > LEAST_DISTANCE, (one.label, other.label, seen)
    assert np.linalg.norm(oklab(SEEN["no green ones"], "#2b8a3e") - oklab(SEEN["no green ones"], "#c92a2a")) < 0.05


def oklab(seen: np.ndarray, colour: str) -> Color:
    """Lightness and two hues, in which distances are those that people see."""
    share = np.array(to_rgb(colour))
    linear = np.clip(seen @ np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4), 0, 1)
    cones = np.array(
        [
            [0.4122214708, 0.5363325363, 0.0514459929],
            [0.2119034982, 0.6806995451, 0.1073969566],
            [0.0883024619, 0.2817188376, 0.6299787005],
        ]
    )
    opponents = np.array(
        [
            [0.2104542553, 0.7936177850, -0.0040720468],
            [1.9779984951, -2.4285922050, 0.4505937099],
            [0.0259040371, 0.7827717662, -0.8086757660],
        ]
    )
    return opponents @ np.cbrt(cones @ linear)


def test_all_cars_have_one_hue(hand_made: Make) -> None:
    (panel,) = shown_of(_shown(hand_made(problem_of(preset("circle")))), 5000).panels["values"]
    (cars,) = (mark for mark in panel.marks if isinstance(mark, Lines))
    assert (cars.kind, len(cars.parts)) == (marks.CARS, 3)


def test_a_margin_that_is_pointed_at_is_rounded_down(hand_made: Make) -> None:
    result = _shown(hand_made(problem_of(preset("circle"))))
    figure = figure_of("margins", "", shown_of(result, 5000).panels["margins"])
    (certified,) = (trace for trace in figure.traces if trace["name"] == "certified margin")
    assert set(certified["text"]) == {"0", "0.2999"}  # of 0.29999
    assert "%{text}" in certified["hovertemplate"] and "%{y" not in certified["hovertemplate"]


PLAIN = Kind("plain", "#000000", fill="#ffffff")


def _panel(*drawn: Lines | Band | Note) -> Panel:
    return Panel("panel", Axis("x", (0.0, 4.0)), Axis("y", (-1.0, 1.0)), drawn)


def test_an_area_has_its_holes() -> None:
    ring = shapely.difference(shapely.box(0, 0, 3, 3), shapely.box(1, 1, 2, 2))
    area = Lines(PLAIN, rings_of(ring))
    turns = [shapely.is_ccw(shapely.linearrings(part)) for part in area.parts]
    assert len(turns) == 2 and turns[0] != turns[1]
    axes = Figure().add_subplot()
    draw(axes, _panel(area))
    (patch,) = axes.patches
    assert patch.get_path().to_polygons()[0].shape == (5, 2) and len(patch.get_path().to_polygons()) == 2
    (trace,) = figure_of("area", "", [_panel(area)]).traces
    assert trace["fill"] == "toself" and trace["x"].count(None) == 1


def test_a_band_without_end_reaches_the_edge_and_has_no_line_there() -> None:
    axes = Figure().add_subplot()
    panel = _panel(Band(PLAIN, 0.5, math.inf), Band(PLAIN, 1.0, 1.0, upright=True))
    draw(axes, panel)
    (area,) = axes.patches
    assert area.get_extents().transformed(axes.transData.inverted()).intervaly.tolist() == pytest.approx([0.5, 1.0])
    level, upright = axes.lines
    assert list(level.get_ydata()) == [0.5, 0.5] and list(upright.get_xdata()) == [1.0, 1.0]
    shapes = figure_of("bands", "", [panel]).layout["shapes"]
    ends = [(shape["type"], shape.get("y0"), shape.get("y1")) for shape in shapes]
    assert ends == [("rect", 0.5, 1.0), ("line", 0.5, 0.5), ("line", 0, 1)]


def test_parts_are_joined_by_gaps_and_lines_without_any_are_left_out() -> None:
    assert np.isnan(joined([np.zeros(2), np.ones(1)])).tolist() == [False, False, True, False]
    assert _panel(Lines(PLAIN, []), Note("text", 0.0)).marks == (Note("text", 0.0),)


def test_every_kind_in_a_legend_has_a_name_of_its_own() -> None:
    named = [kind.label for kind in vars(marks).values() if isinstance(kind, Kind) and kind.label]
    assert len(set(named)) == len(named) > 10
    assert not [label for label in named if re.search(r"[$\\]", label)]  # plain text: both renderers write it
