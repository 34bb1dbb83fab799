"""The tubes that travel with the package: each proven, served to other cars by exact arguments, and to paths."""

import json
import lzma
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flint import fmpq

import cfjax
from cfcheck import Outcome, check_file
from cfjax.certificate import certify
from cfjax.certificate.writing import dump
from cfjax.errors import InputError
from cfjax.funnel import TEMPLATES, Funnel
from cfjax.problem import (
    Box,
    Ellipsoid,
    Interval,
    KinematicBicycle,
    Method,
    Pose,
    Problem,
    Profile,
    ReferencePoint,
    Segment,
    ball,
    circle,
    deviation_rate,
    tube,
)
from cfjax.problem import Path as Course
from cfjax.tubes import follow, for_vehicle, library, library_files, read_tube, scaled
from cfjax.tubes.certified import CertifiedTube
from cfjax.tubes.store import pack


FILES = library_files()


def test_there_is_a_library_of_overlapping_tubes() -> None:
    tubes = library()
    assert len(tubes) == len(FILES) >= 12
    widths = sorted({round(float(t.inverse[1, 1]) ** 0.5, 2) for t in tubes})
    assert widths[0] < 0.07 and widths[-1] > 0.3
    for width in ("narrow", "normal", "wide"):
        some = [t for t in tubes if t.name.startswith(width)]
        assert {float(t.bounds.curvature[1]) for t in some} == {1.2, 2.3}
        slow, fast = (next(t for t in some if t.name.endswith(pace)).bounds.speed for pace in ("slow", "fast"))
        assert slow[0] <= fmpq(1, 2) < fast[0] < slow[1] < fast[1]
    assert sum(file.stat().st_size for file in FILES) < 4 * 2**20
    assert max(file.stat().st_size for file in FILES) < 2**20


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_every_tube_of_the_library_is_proven(file: Path) -> None:
    report = check_file(file)
    assert report.outcome is Outcome.PROVEN, report.message
    found = read_tube(file, check=False)
    assert report.margins == (found.margin,)
    assert report.margin_per_metre == found.margin_per_metre > 0


SHAPE = np.array([[23.48, -12.51, 0, 0], [-12.51, 36.95, 0, 0], [0, 0, 31.36, 11.3], [0, 0, 11.3, 31.87]])
PROBLEM = Problem(tube(1.8, 2.0), inlet=ball(0.15), goal=ball(0.25), method=Method.TT)


@pytest.fixture(scope="module")
def document() -> dict:
    """A small proof: four cells."""
    found = certify(PROBLEM, [Funnel(TEMPLATES["contracting"], SHAPE, 0.0, np.inf)])
    assert found.document is not None, found.message
    return found.document


@pytest.fixture
def proven(document: dict, tmp_path: Path) -> CertifiedTube:
    (tmp_path / "mine.json.xz").write_bytes(pack(dump(document)))
    return read_tube(tmp_path / "mine.json.xz")


def test_reading_a_tube(document: dict, tmp_path: Path, proven: CertifiedTube) -> None:
    assert (proven.name, proven.vehicle, proven.method) == ("mine", "kinematic_bicycle", "tt")
    assert proven.bounds.curvature == (fmpq(-9, 5), fmpq(9, 5)) and proven.bounds.speed == (fmpq(2), fmpq(2))
    assert proven.inputs["u0"] == (fmpq(1), fmpq(1)) and proven.inputs["thrust"] == (fmpq(-4), fmpq(4))
    run = tmp_path / "my_run"
    run.mkdir()
    (run / "certificate.json").write_text(dump(document))
    assert read_tube(run).name == "my_run"
    spoiled = json.loads(json.dumps(document))
    spoiled["funnels"][0]["margin"] = "1000"
    (run / "certificate.json").write_text(json.dumps(spoiled))
    with pytest.raises(InputError, match="hash"):
        read_tube(run)
    (tmp_path / "no.json.xz").write_bytes(b"not packed")
    huge = [{"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": 1 << 30}]
    (tmp_path / "greedy.json.xz").write_bytes(lzma.compress(b"[]", filters=huge))
    (tmp_path / "bomb.json.xz").write_bytes(lzma.compress(b" " * (33 << 20)))
    for name, words in (
        ("no.json.xz", "cannot unpack"),
        ("greedy.json.xz", "cannot unpack"),
        ("bomb.json.xz", "more than 32 MB"),
        ("gone.json", "no such file"),
    ):
        with pytest.raises(InputError, match=words):
            read_tube(tmp_path / name)


def test_a_circles_certificate_is_no_tube(tmp_path: Path) -> None:
    entry = json.loads((Path(__file__).parents[1] / "certificate" / "candidates.json").read_text())["circle tt paper"]
    problem = Problem(circle(), safe=Box((1.0, 1.0, 1.0, 3.0)), method=Method.TT)
    funnel = Funnel(TEMPLATES["paper"], np.array(entry["shape"]), entry["rate"], problem.path.segments[0].duration)
    found = certify(problem, [funnel])
    assert found.document is not None
    (tmp_path / "circle.json").write_text(dump(found.document))
    with pytest.raises(InputError, match="one of something else"):
        read_tube(tmp_path / "circle.json")


def test_similar_cars_move_alike(proven: CertifiedTube) -> None:
    """D f(x, u) S/L is the scaled car's f at the scaled point: to rounding, anywhere."""
    length, speed = 2.5, 1.5
    other = scaled(proven, fmpq(5, 2), fmpq(3, 2))
    own, similar = KinematicBicycle(), KinematicBicycle(0.34 * length, 1.0, 4.0 * speed**2 / length)
    assert {name: float(value) for name, value in other.parameters.items()} == pytest.approx(
        {"wheelbase": similar.wheelbase, "max_tan_steering": 1.0, "max_thrust": similar.max_thrust}
    )
    axes = np.array([1.0, length, length, speed])
    rng = np.random.default_rng(0)
    for _ in range(20):
        x, u = rng.normal(size=4), rng.uniform(-1, 1, 3)
        kappa, v, a = rng.normal(), rng.uniform(1, 3), rng.normal()
        rate = np.array(deviation_rate(own, x, u, ReferencePoint(kappa * v, v, 0.0, a)))
        acceleration = speed**2 / length
        scaled_u = u * np.array([1.0, 1.0, acceleration])
        at = ReferencePoint(kappa / length * v * speed, v * speed, 0.0, a * acceleration)
        np.testing.assert_allclose(
            np.array(deviation_rate(similar, x * axes, scaled_u, at)), rate * axes * speed / length, atol=1e-12
        )


def test_the_tube_of_a_similar_car_is_proven_with_its_margin(proven: CertifiedTube) -> None:
    """Proven once more for itself: the margin is the old one times S/L, as similarity says."""
    other = scaled(proven, fmpq(2), fmpq(2))
    problem = Problem(
        tube(0.9, 4.0),
        inlet=Ellipsoid((0.15, 0.3, 0.3, 0.3)),
        goal=Ellipsoid((0.25, 0.5, 0.5, 0.5)),
        vehicle=KinematicBicycle(0.68, 1.0, 8.0),
        method=Method.TT,
    )
    shape = np.array([[float(entry) for entry in row] for row in other.shape])
    found = certify(problem, [Funnel(TEMPLATES["contracting"], shape, 0.0, np.inf)])
    assert found.margins is not None, found.message
    assert found.margins[0] == pytest.approx(float(other.margin), rel=1e-4)
    assert float(other.margin) == pytest.approx(float(proven.margin))
    assert found.margins_per_metre[0] == pytest.approx(float(proven.margin_per_metre) / 2, rel=1e-4)


def test_tubes_for_other_cars(proven: CertifiedTube) -> None:
    shorter = for_vehicle(proven, KinematicBicycle(0.33))
    assert shorter is not None  # it can do whatever the proven one can: nothing changes but its own limits
    assert (shorter.shape, shorter.bounds, shorter.margin) == (proven.shape, proven.bounds, proven.margin)
    assert shorter.parameters["wheelbase"] == fmpq(33, 100)
    longer = for_vehicle(proven, KinematicBicycle(0.68))
    assert longer is not None
    assert longer.bounds.curvature[1] == fmpq(9, 10)
    assert float(longer.bounds.speed[1]) == pytest.approx(2 * 2**0.5)
    assert [float(end) for end in longer.inputs["thrust"]] == pytest.approx([-4.0, 4.0])
    assert longer.inputs["thrust"][1] <= 4  # which is all that it has
    weaker = for_vehicle(proven, KinematicBicycle(0.34, 1.0, 1.0))
    assert weaker is not None
    assert float(weaker.bounds.speed[1]) == pytest.approx(1.0)
    assert for_vehicle(proven, KinematicBicycle(0.34, 0.5)) is None  # steers less: no scale mends that
    with pytest.raises(ValueError, match="scales"):
        scaled(proven, fmpq(0), fmpq(1))


def oval_like() -> Course:
    """A closed loop by curvature: two straights and two bends of 2 m radius, with ramps; 1.5 m/s."""
    ramp, bend, straight, speed = 1.0, np.pi * 2.0 / 1.5 - 1.0, 2.0, 1.5
    omega = speed / 2.0
    breaks, coefficients = [0.0], []
    for _ in range(2):
        for length, c in (
            (straight, (0.0,)),
            (ramp, (0.0, omega / ramp)),
            (bend, (omega,)),
            (ramp, (omega, -omega / ramp)),
        ):
            breaks.append(breaks[-1] + length)
            coefficients.append(c)
    turn_rate = Profile(tuple(breaks), tuple(coefficients))
    return Course("loop", (Segment(turn_rate, Profile.constant(speed, breaks[-1]), Pose(0.0, 0.0, 0.0)),))


def test_a_path_gets_its_chain_from_the_package() -> None:
    found = cfjax.follow(circle(radius=1.0, speed=1.0))
    assert found.start.name.startswith("narrow") and found.start.name.endswith("slow") and not found.links
    assert cfjax.follow(circle(radius=0.5, speed=1.0)).start.name == "narrow-tight-slow"
    wide = follow(circle(radius=1.0, speed=9.0), pinned="wide-gentle-fast")
    assert wide.start.name == "wide-gentle-fast"
    forever = follow(circle(radius=1.5, speed=1.0), closed=True)
    assert forever.closed and "holds for ever" in forever.describe()
    loop = follow(oval_like(), closed=True)
    assert {stretch.tube.name.split("-")[0] for stretch in loop.tubes} == {"narrow"}
    many = replace(loop, tubes=(*loop.tubes, *wide.tubes) * 50)
    for chain in (found, forever, loop, many):  # ten lines, whatever the length
        assert 3 <= len(str(chain).splitlines()) <= 10
        assert repr(chain) == f"<{str(chain).splitlines()[0]}, {len(chain.tubes)} tubes in turn>"
    assert "  and 95 more tubes\n" in str(many)
    assert loop._repr_html_() == f"<pre>{str(loop).replace('>', '&gt;').replace('<', '&lt;')}</pre>"
    with pytest.raises(InputError, match=r"curvature reaches 2\.5 1/m .* 0\.2 above 2\.3"):
        follow(circle(radius=0.4, speed=1.0))
    with pytest.raises(InputError, match="speed"):
        follow(circle(radius=1.5, speed=40.0))
    other = follow(circle(radius=3.0, speed=1.0), vehicle=KinematicBicycle(0.68))
    assert float(other.start.parameters["wheelbase"]) == 0.68
    bounds = Course("tube", tube(1.0, Interval(1.0, 2.0)).segments)
    with pytest.raises(InputError, match="which has no course to follow"):
        follow(bounds)


def test_given_tubes_are_used(proven: CertifiedTube) -> None:
    found = follow(circle(radius=1.0, speed=2.0), [proven])
    assert found.start is proven
    with pytest.raises(InputError, match="speed"):
        follow(circle(radius=1.0, speed=2.1), [replace(proven)])
