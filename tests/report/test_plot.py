"""The picture: regions against slow references, and nothing clipped, hidden or skewed."""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from cfjax.conf import preset, preset_names, problem_of
from cfjax.errors import InputError
from cfjax.funnel import Funnel, template_named
from cfjax.problem import Disc, Ellipsoid, FootprintDisc, Problem, Vehicle, ball, circle, tube
from cfjax.problem import Path as RoadPath
from cfjax.report.marks import END, GOAL, INLET, START, TUBE, Axis, Lines, Panel
from cfjax.report.marks import FUNNEL as FUNNEL_KIND
from cfjax.report.page import save_page
from cfjax.report.panels import shown_of, shown_pairs
from cfjax.report.plane import PathPoses, Plane, body_region, disc_shadows, positions, shadows, swept
from cfjax.report.plot import POINTS, compose, plot, save_picture
from cfjax.report.result_json import result_json
from cfjax.report.style import STYLE
from cfjax.result import Result, Rollouts, StretchMargin
from cfjax.verdict import Verdict
from experiments.vehicles.omnidirectional import Omnidirectional
from experiments.vehicles.steered_car import SteeredCar
from tests.shapes import eight


Make = Callable[..., Result]  # hand_made

SHAPE = np.array([[6.0, 1.5, -0.5, 0.3], [1.5, 5.0, 0.8, 0.1], [-0.5, 0.8, 4.5, 0.4], [0.3, 0.1, 0.4, 7.0]])
FUNNEL = Funnel(template_named("contracting"), 4 * SHAPE, 0.8, 1.7359, 0.9)


def _problem(name: str) -> Problem:
    return problem_of(preset(name))


def _inside(funnel: Funnel, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Deviations on the funnel's boundary, one per θ."""
    direction = rng.normal(size=(len(theta), 4))
    return direction * np.sqrt(funnel.level(theta) / funnel.form(direction))[:, None]


def test_swept_shadow_is_the_union_of_many_ellipses() -> None:
    course = PathPoses(_problem("obstacle"))
    few, many = course.between(0.0, FUNNEL.duration, 0.1, 10_000), np.linspace(0.0, FUNNEL.duration, 1500)
    region = swept(shadows(FUNNEL, few, course(few)))
    union = shapely.union_all(shapely.polygons(shadows(FUNNEL, many, course(many))))
    assert shapely.hausdorff_distance(region.exterior, union.exterior) < 2e-3
    assert region.area == pytest.approx(union.area, rel=2e-3)


@pytest.mark.parametrize("offset", [0.0, 0.3, -0.2])
def test_the_body_is_where_cars_of_the_funnel_are_and_no_farther(offset: float) -> None:
    course, rng = PathPoses(_problem("obstacle")), np.random.default_rng(0)
    theta = course.between(0.0, FUNNEL.duration, 0.1, 10_000)
    region = body_region(FUNNEL, theta, course(theta), [FootprintDisc(0.1, offset)])
    at = np.repeat(np.linspace(0.0, FUNNEL.duration, 40), 500)
    x, poses = _inside(FUNNEL, at, rng), course(at)
    origins = positions(poses, x)
    alpha = poses[:, 0] + x[:, 0]
    centres = origins + offset * np.stack([-np.sin(alpha), np.cos(alpha)], axis=-1)
    bodies = shapely.buffer(shapely.points(centres), 0.1)
    assert shapely.difference(shapely.union_all(bodies), shapely.buffer(region, 2e-3)).is_empty
    if not offset:
        plain = shapely.buffer(swept(shadows(FUNNEL, theta, course(theta))), 0.1, quad_segs=24)
        assert shapely.hausdorff_distance(region, plain) < 1e-9


def test_hull_of_a_disc_ahead_is_tight() -> None:
    course, theta = PathPoses(_problem("obstacle")), np.array([0.4])
    pose = course(theta)
    (corners,) = disc_shadows(FUNNEL, theta, pose, 0.3)
    x = _inside(FUNNEL, np.repeat(theta, 100_000), np.random.default_rng(1))
    alpha = pose[0, 0] + x[:, 0]
    ahead = 0.3 * np.stack([-np.sin(alpha), np.cos(alpha)], axis=-1)
    seen = shapely.convex_hull(shapely.multipoints(positions(np.repeat(pose, len(x), axis=0), x) + ahead))
    assert shapely.hausdorff_distance(shapely.convex_hull(shapely.multipoints(corners)), seen) < 0.02


def test_cars_are_where_the_segments_poses_say() -> None:
    problem = _problem("figure_eight")
    path = problem.path
    theta = np.array([0.5, path.curve[0].duration + 1.5])
    found = positions(PathPoses(problem)(theta), np.zeros((2, 4)))
    wanted = [path.curve[0].poses(np.array([0.5]))[0, 1:], path.curve[1].poses(np.array([1.5]))[0, 1:]]
    np.testing.assert_allclose(found, wanted, atol=1e-7)


def _with_cars(result: Result) -> Result:
    """Cars by hand, that stay a little off the reference."""
    end = sum(segment.duration for segment in result.problem.path.curve)
    theta = np.linspace(0.0, end, 50)[:, None] * np.ones((1, 3))
    x = np.zeros((50, 3, 4)) + 0.05 * np.arange(3)[None, :, None]
    return result.replace(rollouts=(Rollouts(theta, theta, x, 0.5 * np.exp(-theta), np.ones((50, 3, 3))),))


def _certified(result: Result) -> Result:
    """As if it were proven in two stretches for each segment."""
    halves = [
        (StretchMargin(0.0, s.duration / 3, 0.4), StretchMargin(s.duration / 3, s.duration, 0.3))
        for s in result.problem.path.curve
    ]
    segments = zip(result.segments, halves, strict=True)
    return _with_cars(result).replace(
        verdict=Verdict.CERTIFIED,
        segments=tuple(replace(found, margin_certified=0.3, stretches=each) for found, each in segments),
    )


def _failed(result: Result) -> Result:
    return result.replace(failed_at=(0.3, 0.6))


def _touching(result: Result) -> Result:
    return result.replace(failed_at=(0.3, 0.3))


def _without_candidate(result: Result) -> Result:
    return result.replace(segments=(), closed_loop=None)


PATHS = [name for name in preset_names() if name not in ("waypoints", "tube", "plan")]


def _all_in_place(result: Result, draw: Callable[[Result], Figure] = plot, titled: bool = True) -> None:
    """Axes and what belongs to them lie in the figure and beside each other; metres are as long in y as in x."""
    with matplotlib.rc_context(STYLE):
        figure = draw(result)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        renderer = canvas.get_renderer()
        boxes = [axes.get_tightbbox(renderer) for axes in figure.axes]
        boxes += [legend.get_window_extent(renderer) for legend in figure.legends]
        assert bool(figure.get_suptitle()) == titled
        if titled:
            boxes.append(figure._suptitle.get_window_extent(renderer))  # pyright: ignore[reportAttributeAccessIssue]
        for box in boxes:
            assert box.x0 >= -1 and box.y0 >= -1
            assert box.x1 <= figure.bbox.width + 1 and box.y1 <= figure.bbox.height + 1
        for one, other in combinations(boxes, 2):
            assert not one.padded(-2).overlaps(other.padded(-2))
        plane = next(axes for axes in figure.axes if axes.get_xlabel() == "x (m)")
        (x0, y0), (x1, y1) = plane.transData.transform([(0.0, 0.0), (1.0, 1.0)])
        assert x1 - x0 == pytest.approx(y1 - y0)


@pytest.mark.parametrize("state", [_certified, _failed, _without_candidate], ids=lambda state: state.__name__)
@pytest.mark.parametrize("name", PATHS)
def test_nothing_is_clipped_or_hidden(hand_made: Make, name: str, state: Callable[[Result], Result]) -> None:
    _all_in_place(state(hand_made(_problem(name))))


@pytest.mark.parametrize("name", ["circle", "slalom"])  # panels beside the plane, and below it
def test_long_titles_have_room(hand_made: Make, name: str) -> None:
    def drawn(result: Result) -> Figure:
        titles = {"values": "V(θ, x)", "lateral": "lateral error (m)", "command": "angle of the front wheels (rad)"}
        panels = [Panel(name, Axis("clock (s)"), Axis(title), ()) for name, title in titles.items()]
        return compose(Plane(result).panel([]), panels, "a simulation")

    _all_in_place(hand_made(_problem(name)), drawn)


def test_a_long_chain_with_varying_speed(hand_made: Make, write: Callable[..., Path]) -> None:
    config = preset("waypoints", [f"path.file={write(eight())}", "path.closed=true", "path.speed=3"])
    _all_in_place(_certified(hand_made(problem_of(config))))


@pytest.mark.parametrize("width", ["column", "page", 12.0])
@pytest.mark.parametrize("name", ["circle", "obstacle", "oval", "straight"])
def test_for_a_paper_all_is_in_place_too(hand_made: Make, name: str, width: str | float) -> None:
    result = _certified(hand_made(_problem(name)))

    def drawn(result: Result) -> Figure:
        return result.plot(width=width)

    _all_in_place(result, drawn, titled=False)  # which is the caption's part
    figure = drawn(result)
    assert figure.get_figwidth() * 2.54 == pytest.approx({"column": 8.8, "page": 18.1}.get(str(width), width))
    assert {text.get_fontsize() for axes in figure.axes for text in axes.get_xticklabels()} == {8}
    assert figure.axes[0].xaxis.label.get_fontname() == "STIXGeneral"


def test_sections_of_a_tube_stand_two_in_a_row_in_a_column(hand_made: Make) -> None:
    figure = hand_made(_problem("tube")).plot(width="column")
    rows = [axes.get_subplotspec().get_topmost_subplotspec().rowspan.start for axes in figure.axes]
    assert rows == [0, 0, 1]


def test_a_width_that_is_none_is_one_line(hand_made: Make) -> None:
    made = hand_made(_problem("circle"))
    for wrong, line in (
        ("wide", "one of column, page"),
        (2.0, "at least 6 and at most 60"),
        (900.0, "at least 6 and at most 60"),
    ):
        with pytest.raises(InputError, match=f"width: .*{line}"):
            made.plot(width=wrong)


def test_picture_is_a_file(hand_made: Make, tmp_path: Path) -> None:
    for index, result in enumerate((hand_made(_problem("oval")), _touching(hand_made(_problem("obstacle_tight"))))):
        save_picture(result, tmp_path / f"{index}.png")
        assert (tmp_path / f"{index}.png").read_bytes()[:4] == b"\x89PNG"


def test_panels_say_something(hand_made: Make) -> None:
    def drawn(result: Result) -> list[str]:
        return [axes.get_ylabel() for axes in result.plot().axes][1:]  # without the plane

    assert drawn(_certified(hand_made(_problem("circle")))) == ["V(θ, x)"]  # nothing varies but V
    assert drawn(hand_made(_problem("circle"))) == []
    assert drawn(_certified(hand_made(_problem("oval")))) == ["V(θ, x)", "κ (1/m)", "λ (1/s)"]
    assert drawn(_failed(hand_made(_problem("oval")))) == ["κ (1/m)", "λ (1/s)"]
    assert drawn(_without_candidate(hand_made(_problem("oval")))) == ["κ (1/m)"]


def test_what_was_asked_is_drawn_beside_the_funnel(hand_made: Make) -> None:
    """I around the reference's first place, G around its last one, in its frame: half-axes x to the right, y ahead."""
    problem = replace(problem_of(preset("straight")), inlet=Ellipsoid((0.5, 0.3, 0.2, 0.5)), goal=ball(0.4))
    plane = Plane(hand_made(problem))
    marks = {mark.kind: mark for mark in plane.panel([]).marks if isinstance(mark, Lines)}
    assert {START, END, INLET, GOAL} <= set(marks)
    start, end = plane.line[[0, -1]]
    ahead = (end - start) / np.linalg.norm(end - start)
    right = np.array([ahead[1], -ahead[0]])
    at = marks[INLET].parts[0] - start
    assert np.abs(at @ right).max() == pytest.approx(0.3, rel=1e-3)
    assert np.abs(at @ ahead).max() == pytest.approx(0.2, rel=1e-3)
    assert np.linalg.norm(marks[GOAL].parts[0] - end, axis=1) == pytest.approx(0.4)
    ends = [marks[kind].theta[0].tolist()[0] for kind in (INLET, START, GOAL, END)]
    assert ends == pytest.approx([0.0, 0.0, plane.end, plane.end])


def test_starts_and_ends_of_every_segment(hand_made: Make) -> None:
    result = hand_made(_problem("slalom"))
    plane = Plane(result)
    assert len(plane.starts) == len(plane.ends) == len(result.spans) == 6
    for end, start in zip(plane.ends, plane.starts[1:], strict=False):  # the funnels made by hand contract
        assert shapely.contains_properly(shapely.Polygon(start), shapely.Polygon(end))


def test_far_obstacles_do_not_shrink_the_picture(hand_made: Make) -> None:
    problem = _problem("obstacle")
    near = Plane(hand_made(problem)).view([])
    far = replace(problem, obstacles=(*problem.obstacles, Disc(40.0, 0.0, 2.0)))
    assert Plane(hand_made(far)).view([]) == near
    wide = replace(problem, obstacles=(*problem.obstacles, Disc(0.0, 22.0, 20.0)))
    low, high = Plane(hand_made(wide)).view([])[2:]
    assert near[3] < high < near[3] + 0.3 * (near[1] - near[0])
    assert low == near[2]


@pytest.mark.parametrize(("states", "pairs"), [(3, 3), (4, 3), (5, 4), (6, 5)])
def test_every_state_is_drawn_over_another_one(states: int, pairs: int) -> None:
    drawn = shown_pairs(states)
    assert len(set(map(frozenset, drawn))) == len(drawn) == pairs
    assert all(one != other for one, other in drawn)
    assert {state for pair in drawn for state in pair} == set(range(states))


@pytest.mark.parametrize("vehicle", [Omnidirectional(), SteeredCar()], ids=["three states", "five states"])
@pytest.mark.parametrize(
    ("path", "has_goal"),
    [(tube(1.5, 0.7), True), (tube(1.5, 0.7), False), (circle(), True)],
    ids=["tube", "tube without G", "circle"],
)
def test_vehicles_of_other_sizes_have_their_pictures(
    hand_made: Make, vehicle: Vehicle, path: RoadPath, has_goal: bool, tmp_path: Path
) -> None:
    size = len(vehicle.state_names)
    goal = ball(0.6, size) if has_goal else None
    made = hand_made(Problem(path, vehicle=vehicle, inlet=ball(0.3, size), goal=goal))
    save_picture(made, tmp_path / "funnel.png")
    save_page(made, tmp_path / "report.html")
    sections = shown_of(made, POINTS).panels["sections"]
    inverse = np.linalg.inv(made.segments[0].funnel.shape)
    first = TUBE if path.tube else FUNNEL_KIND
    for (i, j), section in zip(shown_pairs(size), sections, strict=True):
        lines = [mark for mark in section.marks if isinstance(mark, Lines)]
        assert [mark.kind for mark in lines] == [first, *[GOAL] * has_goal, INLET]
        np.testing.assert_allclose(lines[0].parts[0].max(axis=0), np.sqrt([inverse[i, i], inverse[j, j]]), rtol=2e-3)
    assert result_json(made)["sets"]["goal"] == ([0.6] * size if has_goal else None)


def test_a_panel_goes_into_axes_of_ones_own(hand_made: Make) -> None:
    result = _certified(hand_made(_problem("oval")))
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert result.plot("plane", left) is figure
    assert result.plot("margins", right) is figure
    assert (left.get_xlabel(), right.get_ylabel()) == ("x (m)", "λ (1/s)")
    assert [axes.get_ylabel() for axes in result.plot("input thrust").axes] == ["thrust (m/s²)"]
    with pytest.raises(InputError, match=r"panel: expected one of plane, .*, got sped"):
        result.plot("sped")
    with pytest.raises(InputError, match="panel: expected one of plane"):
        result.plot(axes=left)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_same_picture_is_the_same_file(hand_made: Make, tmp_path: Path, suffix: str) -> None:
    result = _certified(hand_made(_problem("circle")))
    for name in ("one", "other"):
        save_picture(result, (tmp_path / name).with_suffix(suffix))
    one, other = ((tmp_path / name).with_suffix(suffix).read_bytes() for name in ("one", "other"))
    assert one == other
    assert {".png": b"PNG", ".svg": b"<svg", ".pdf": b"%PDF"}[suffix] in one[:1000]


def test_a_picture_looks_alike_whatever_the_users_settings(hand_made: Make) -> None:
    result = _certified(hand_made(_problem("circle")))

    def pixels() -> bytes:
        canvas = FigureCanvasAgg(result.plot())
        canvas.draw()
        return bytes(canvas.buffer_rgba())

    plain = pixels()
    with matplotlib.rc_context(
        {"font.size": 20, "font.family": "sans-serif", "axes.spines.top": True, "legend.frameon": True}
    ):
        assert pixels() == plain
