"""Corridors and crowded scenes along paths in tubes: proven, seen by an independent sampler, refused and spoiled."""

import copy
import json
from collections.abc import Sequence
from pathlib import Path as File

import numpy as np
import pytest
import shapely

from cfcheck import Outcome, check_document
from cfcheck.claims.document import document_hash
from cfjax.errors import InputError
from cfjax.options import Options
from cfjax.problem import Disc, FootprintDisc, Obstacle, Path, Polygon, Problem, Wall, circle, oval, slalom, straight
from cfjax.problem.corridor import walls_of, with_own_points
from cfjax.problem.point_path import waypoints
from cfjax.synthesis import search
from cfjax.tubes import follow
from cfjax.tubes.__main__ import main
from cfjax.tubes.certificate import chain_document
from cfjax.tubes.follow import Following
from cfjax.verdict import Verdict


BODY = (FootprintDisc(0.2, 0.0), FootprintDisc(0.15, 0.3))


def least_gap(found: Following, obstacles: Sequence[Obstacle], cars: int, seed: int = 0) -> float:
    """The least distance (m) of the body from what is around, over random cars on the boundary of their tubes."""
    shapes = [shapely.buffer(o.shape, o.radius, quad_segs=256) if isinstance(o, Disc) else o.shape for o in obstacles]
    around = shapely.GeometryCollection(shapes)
    shapely.prepare(around)
    rng, least = np.random.default_rng(seed), np.inf
    for stretch in found.tubes:
        segment = found.path.curve[stretch.segment]
        theta = np.repeat(rng.uniform(stretch.start, stretch.end, cars // 50), 50)
        heading, x, y = segment.poses(theta).T
        shape = np.array([[float(entry) for entry in row] for row in stretch.tube.shape])
        w = rng.normal(size=(len(theta), len(shape)))
        d = w / np.sqrt(np.einsum("ki,ij,kj->k", w, shape, w))[:, None]
        cos, sin = np.cos(heading), np.sin(heading)
        x, y, heading = x + cos * d[:, 1] - sin * d[:, 2], y + sin * d[:, 1] + cos * d[:, 2], heading + d[:, 0]
        for disc in BODY:
            centres = shapely.points(x - disc.offset * np.sin(heading), y + disc.offset * np.cos(heading))
            least = min(least, float(shapely.distance(around, centres).min()) - disc.radius)
    return least


@pytest.fixture(scope="module")
def lap() -> Following:
    return follow(oval(), closed=True, corridor={"left": 0.6, "right": 0.5}, footprint=BODY)


@pytest.fixture(scope="module")
def document(lap: Following) -> dict:
    return chain_document(lap)


def sealed(document: dict) -> dict:
    return {**document, "hash": document_hash(document)}


# --- truth


def test_a_lap_in_its_corridor_is_proven_and_no_car_touches_it(lap: Following, document: dict) -> None:
    report = check_document(document)
    assert report.outcome is Outcome.PROVEN
    points = sum(len(wall.points) for wall in lap.surroundings.walls)
    assert f"clear of 2 walls through {points} points that stand in the file, by a footprint of" in report.message
    assert "clear of the walls" in report.message and "lap after lap for ever" in report.message
    assert "clear of 2 walls, wherever in its tube the car is" in str(lap)
    walls = walls_of({"left": 0.6, "right": 0.5}, oval(), True)
    assert 0 < least_gap(lap, walls, 20_000) < 0.2


@pytest.mark.slow
def test_a_funnel_of_the_path_s_own_is_proven_between_walls() -> None:
    walls = {"left": 0.6, "right": 0.7}
    problem = Problem(circle(1.5, 1.5), inlet=0.1, goal=0.2, corridor=walls, footprint=BODY)
    result = search(problem, Options(certificate="segment", robustness=False))
    assert result.verdict is Verdict.CERTIFIED and "clear of 2 walls through" in result.message


def test_walls_keep_their_half_widths() -> None:
    path = slalom(amplitude=0.4)
    left, right = walls_of({"left": 0.7, "right": 0.4}, path)
    line = shapely.LineString(np.concatenate([s.poses(np.linspace(0, s.duration, 400))[:, 1:] for s in path.curve]))
    for wall, width in ((left, 0.7), (right, 0.4)):
        ends = shapely.Point(wall.points[0]), shapely.Point(wall.points[-1])
        inner = [p for p in map(shapely.Point, wall.points) if min(p.distance(end) for end in ends) > 1.0]
        apart = [point.distance(line) for point in inner]
        assert len(apart) > 10 and max(abs(value - width) for value in apart) < 3e-3


def test_half_widths_may_change_along_the_path() -> None:
    left, right = walls_of({"left": [1.0, 2.0], "right": [0.5, 0.5], "theta": [0.0, 5.0]}, straight(10.0, 2.0))
    line = shapely.LineString(straight(10.0, 2.0).curve[0].poses(np.array([0.0, 5.0]))[:, 1:])
    assert [shapely.Point(p).distance(line) for p in (left.points[0], left.points[-1])] == pytest.approx([1.0, 2.0])
    assert {round(shapely.Point(p).distance(line), 3) for p in right.points} == {0.5}


def scene(seed: int) -> list[Obstacle]:
    """Discs, stars and bits of wall about a slalom, some of them close to it."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(25):
        x, y = rng.uniform(-1, 13), rng.choice([-1, 1]) * (0.55 + rng.exponential(0.6))
        kind, size = rng.integers(3), rng.uniform(0.05, 0.3)
        angles = np.sort(rng.uniform(0, 2 * np.pi, 7))
        star = np.array([x, y]) + size * rng.uniform(0.4, 1.0, 7)[:, None] * np.stack(
            [np.cos(angles), np.sin(angles)], 1
        )
        if kind == 0:
            found.append(Disc(x, y, size))
        elif kind == 1 and shapely.Polygon(star).is_valid:
            found.append(Polygon(star))
        else:
            found.append(Wall(star[:3]))
    return found


def followed(path: Path, obstacles: list[Obstacle]) -> Following | None:
    """None where something is in the way."""
    try:
        return follow(path, obstacles=obstacles, footprint=BODY)
    except InputError:
        return None


def test_in_crowded_scenes_nothing_that_is_accepted_is_touched() -> None:
    path, accepted = slalom(amplitude=0.2), 0
    for seed in range(12):
        obstacles = scene(seed)
        found = followed(path, obstacles)
        if found is None:
            continue
        accepted += 1
        assert check_document(chain_document(found)).outcome is Outcome.PROVEN
        assert least_gap(found, obstacles, 4000, seed) > 0
    assert 3 <= accepted <= 11


# --- files


def track_file(folder: File, widths: str = "w_tr_right_m, w_tr_left_m", unit: float = 1.0) -> File:
    """An ellipse as a centre line of a race track, anticlockwise: 1.1 m to the right, 0.6 m to the left."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rows = [f"{4 * np.cos(a):.5f}, {3 * np.sin(a):.5f}, {1.1 * unit}, {0.6 * unit}" for a in angle]
    file = folder / "track.csv"
    file.write_text(f"# x_m, y_m, {widths}\r\n" + "\r\n".join(rows) + "\r\n", encoding="utf-8-sig")
    return file


@pytest.mark.parametrize(
    ("widths", "unit"), [("w_tr_right_m, w_tr_left_m", 1.0), ("width_right_cm, width_left_cm", 100)]
)
def test_the_widths_of_a_track_file_are_walls_where_they_are_asked_for(
    tmp_path: File, widths: str, unit: float, capsys: pytest.CaptureFixture
) -> None:
    path = waypoints(track_file(tmp_path, widths, unit))
    assert path.source.endswith(f"; {widths} used with sets.corridor=file only")
    assert follow(path, closed=True).surroundings.is_empty
    left, right = walls_of("file", path)
    assert left.points[0] == left.points[-1] == pytest.approx((3.4, 0.0), abs=2e-3)
    assert right.points[0] == pytest.approx((5.1, 0.0), abs=2e-3)
    assert main([str(tmp_path / "track.csv"), "--corridor", "file", "--certificate", str(tmp_path / "c.json")]) == 0
    assert "clear of 2 walls" in capsys.readouterr().out
    assert check_document(json.loads((tmp_path / "c.json").read_text())).outcome is Outcome.PROVEN


def test_the_command_says_what_is_no_corridor(tmp_path: File, capsys: pytest.CaptureFixture) -> None:
    assert main([str(track_file(tmp_path)), "--corridor", "0.2", "0.3", "--footprint", "0.25", "0"]) == 2
    assert "comes within 0.2 m of wall 0; expected more" in capsys.readouterr().err
    assert main([str(track_file(tmp_path)), "--corridor", "1", "2", "3"]) == 2
    assert "sets.corridor: expected a half-width" in capsys.readouterr().err


def test_columns_of_widths_in_memory() -> None:
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    table = {
        "x": 4 * np.cos(angle),
        "y": 3 * np.sin(angle),
        "left_width": np.full(60, 0.6),
        "right_width": 1 + 0 * angle,
    }
    left, right = walls_of("file", waypoints(table))
    assert (left.points[0][0], right.points[0][0]) == pytest.approx((3.4, 5.0), abs=2e-3)


# --- refusals


ALONG = straight(10.0, 2.0)


@pytest.mark.parametrize(
    ("corridor", "words"),
    [
        (-1, "sets.corridor.left: expected"),
        ("wide", r'sets.corridor: expected a half-width in m, {left: …, right: …} with .*, or "file"'),
        ("file", "sets.corridor: expected a path from a file with columns of widths"),
        ({"left": 1}, "sets.corridor: expected a half-width"),
        ({"left": [1, -1], "right": [1, 1], "theta": [0, 5]}, "sets.corridor.left: expected half-widths above 0 m"),
        ({"left": [1, 1], "right": [1, 1], "theta": [5, 0]}, "sets.corridor.theta: expected increasing"),
        (0.1, r"path: segment 0 at theta = .* comes within 0.1 m of wall 0; expected more than .* 0.2 m"),
        (0.22, r"wall [01] at \(.*\) m is in the way: from theta = 0 s of segment 0, .*and 0\.\d+ m beyond in the one"),
    ],
)
def test_what_is_no_corridor_is_said_in_one_line(corridor: object, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        follow(ALONG, corridor=corridor, footprint=BODY)
    assert "\n" not in str(caught.value)


def test_edges_that_cross_and_paths_that_leave_are_placed() -> None:
    path = circle(3.0, 1.0)
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    middle = path.curve[0].poses(np.linspace(0, path.curve[0].duration, 200))[:-1, 1:].mean(axis=0)

    def ring(radius: float) -> np.ndarray:
        return middle + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)

    inner, outer = ring(2.0), ring(4.0)
    first = shapely.Point(path.curve[0].start[1:])
    turns_left = path.curve[0].turn_rate.values(np.zeros(1))[0] > 0
    sides = ("left", "right") if turns_left else ("right", "left")
    good = dict(zip(sides, (inner, outer), strict=True))
    assert first.distance(shapely.Point(middle)) == pytest.approx(3.0)
    assert follow(path, closed=True, corridor=good).surroundings.walls
    bent = outer.copy()
    bent[20] = middle + (bent[20] - middle) * 0.3
    with pytest.raises(InputError, match=r"sets.corridor: the edges cross each other at \(.*\) m, beside the path at"):
        follow(path, closed=True, corridor={**good, sides[1]: bent})
    bent[20] = middle + (outer[20] - middle) * 0.65
    with pytest.raises(InputError, match=r"path: leaves its corridor at theta = .* s, \(.*\) m, where it crosses the"):
        follow(path, closed=True, corridor={**good, sides[1]: bent})
    with pytest.raises(InputError, match=r"path: begins outside its corridor, at theta = 0 s, .* on the other side"):
        follow(path, closed=True, corridor=dict(zip(sides, (outer, inner), strict=True)))
    twisted = outer[[*range(20), 22, 21, 20, *range(23, 60)]]
    with pytest.raises(InputError, match=rf"sets.corridor: the {sides[1]} edge crosses itself at"):
        follow(path, closed=True, corridor={**good, sides[1]: twisted})


def test_a_tube_has_no_corridor() -> None:
    from cfjax.problem import Tube

    with pytest.raises(InputError, match=r"sets\.corridor: expected none for a tube"):
        Problem(Path("tube", (Tube((-1, 1), (1, 1), (0, 0)),)), inlet=0.1, goal=0.2, corridor=1.0)


# --- attacks


def wall(document: dict) -> list:
    return document["problem"]["sets"]["obstacles"][0]["wall"]


def a_point_inward(document: dict) -> None:
    """The middle of the left wall on the right one's place."""
    wall(document)[len(wall(document)) // 2] = document["problem"]["sets"]["obstacles"][1]["wall"][0]


def first_stretch(document: dict) -> dict:
    return document["hints"]["clearance"][0][0]


@pytest.mark.parametrize(
    ("spoil", "outcome", "words"),
    [
        (a_point_inward, Outcome.BROKEN, "wall 0 at ("),
        (lambda d: wall(d).__delitem__(slice(1, None)), Outcome.UNREADABLE, "wall: expected a list of 2 to"),
        (lambda d: first_stretch(d).update(normals=first_stretch(d)["normals"][:1]), Outcome.BROKEN, "wall"),
        (lambda d: d["hints"]["clearance"][0].pop(), Outcome.BROKEN, "stretches whose ends increase"),
        (lambda d: first_stretch(d).update(normals=[["1", "0"]]), Outcome.UNREADABLE, "a whole number"),
        (lambda d: d["problem"]["sets"]["footprint"][1].update(offset="7/10"), Outcome.BROKEN, "wall"),
    ],
)
def test_what_is_spoiled_is_refused(document: dict, spoil, outcome: Outcome, words: str) -> None:
    spoiled = copy.deepcopy(document)
    spoil(spoiled)
    report = check_document(sealed(spoiled))
    assert report.outcome is outcome and words in report.message


def test_a_wall_less_is_proven_and_said(document: dict) -> None:
    weaker = json.loads(json.dumps(document))
    weaker["problem"]["sets"]["obstacles"].pop()
    del weaker["problem"]["sets"]["obstacles"][0]["side"]  # a corridor has two walls
    report = check_document(sealed(weaker))
    assert report.outcome is Outcome.PROVEN and "clear of one wall through" in report.message


def test_a_corridor_of_files_needs_them_no_more_once_it_holds_their_points(tmp_path: File) -> None:
    path = circle(radius=3.0, speed=2.0)
    angle = np.linspace(0, 2 * np.pi, 50)
    centre = path.curve[0].poses(np.linspace(0, path.curve[0].duration, 200))[:, 1:].mean(axis=0)
    for name, radius in (("left", 1.6), ("right", 4.4)):
        points = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        np.savetxt(tmp_path / f"{name}.csv", points, delimiter=",", header="x,y", comments="")
    named = {"left": "left.csv", "right": "right.csv"}
    own = with_own_points(named, tmp_path)
    files = {side: str(tmp_path / file) for side, file in named.items()}
    ((left, right), (one, other)) = (walls_of(corridor, path, closed=True) for corridor in (own, files))
    for file in files.values():
        File(file).unlink()
    assert np.array_equal(left.points, one.points) and np.array_equal(right.points, other.points)
    with pytest.raises(InputError, match=r"left\.csv"):
        with_own_points(named, tmp_path)
    assert with_own_points(1.5, tmp_path) == 1.5
