"""Paths and the chains they get, or the line that says why they get none."""

import dataclasses
import importlib
import itertools
import json
import math
import pathlib
import re

import numpy as np
import pytest
from flint import fmpq

from cfcheck.claims.document import document_hash
from cfcheck.exact.rational import rational
from cfcheck.kernel.funnel import LAW_SHARE
from cfcheck.reader import read_json
from cfjax.errors import InputError
from cfjax.exact import exact_reference, stated
from cfjax.problem import KinematicBicycle, Path, Pose, Profile, Segment, Twist, circle, straight
from cfjax.problem import tube as bounds
from cfjax.tubes import CertifiedTube, Following, follow, library, library_files, read_tube
from tests import by_hand


LAP_PARTS = 5


def tube(
    name: str, curvature: float = 1.0, scale: float = 1.0, margin: float = 1.0, speed: tuple[float, float] = (0.5, 2.0)
) -> CertifiedTube:
    """A tube that nobody certified, lateral half-width about √(1/(5 scale)); the law lowers V by margin/2 per metre."""
    return by_hand.tube(
        name,
        by_hand.bounds(rational(curvature), (rational(speed[0]), rational(speed[1]))),
        rational(scale),
        margin_per_metre=rational(margin) / LAW_SHARE,
    )


WIDE, NARROW = tube("wide", 2.0), tube("narrow", 0.1, scale=2.0)


def segment(
    turn_rate: list[tuple[float, ...]],
    speed: list[tuple[float, ...]],
    breaks: tuple[float, ...],
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Segment:
    return Segment(Profile(breaks, tuple(turn_rate)), Profile(breaks, tuple(speed)), Pose(*start))


def curved(kappas: list[float], lengths: list[float]) -> Path:
    """Arcs at 1 m/s, so that θ is arc length."""
    breaks = tuple(float(round(b, 12)) for b in np.concatenate([[0.0], np.cumsum(lengths)]))
    return Path("curved", (segment([(k,) for k in kappas], [(1.0,)] * len(kappas), breaks),))


def names(following: Following) -> list[str]:
    return [stretch.tube.name for stretch in following.tubes]


# --- bounds


def test_a_path_at_the_bound_passes_and_above_it_does_not() -> None:
    assert names(follow(curved([2.0, -2.0], [1.0, 1.0]), [WIDE])) == ["wide"]
    with pytest.raises(
        InputError,
        match=r"^path curved: curvature reaches 2 1/m at theta = 1 s of segment 0 \(after 1 m\): 1e-12 above 2",
    ):
        follow(curved([0.0, 2.000000000001], [1.0, 1.0]), [WIDE, NARROW])
    with pytest.raises(InputError, match="1e-12 below -2, where tube wide ends"):
        follow(curved([0.0, -2.000000000001], [1.0, 1.0]), [WIDE, NARROW])


def test_a_spike_inside_a_piece_is_told_where_it_is() -> None:
    # 2 at θ = 0, 1/2 and 1 and above it by 0.0048 between the first two
    path = Path("spike", (segment([(2.0, 0.05, -0.15, 0.1)], [(1.0,)], (0.0, 1.0)),))
    with pytest.raises(
        InputError, match=r"curvature reaches 2.00481 1/m at theta = 0.211325 s of segment 0 .*: 0.0048"
    ):
        follow(path, [WIDE])


def test_speed_and_acceleration_are_bounded_too() -> None:
    fast = Path("fast", (segment([(0.0,)], [(1.0, 0.75)], (0.0, 2.0)),))
    with pytest.raises(
        InputError, match=r"speed reaches 2.5 m/s at theta = 2 s of segment 0 \(after 3.5 m\): 0.5 above 2"
    ):
        follow(fast, [WIDE])
    sudden = Path("sudden", (segment([(0.0,)], [(1.0, 0.0, 0.75)], (0.0, 1.0)),))
    with pytest.raises(InputError, match=r"acceleration reaches 1.5 m/s² at theta = 1 s .*: 0.5 above 1"):
        follow(sudden, [WIDE])
    halting = Path("halting", (segment([(0.0,)], [(0.6, -0.6)], (0.0, 1.0)),))
    with pytest.raises(InputError, match=r"speed reaches 0 m/s at theta = 1 s .*: 0.5 below 0.5"):
        follow(halting, [WIDE])


def test_the_answer_speaks_of_the_nearest_tube() -> None:
    with pytest.raises(InputError, match=r"curvature reaches 3 1/m at theta = 4 s .*: 1 above 2, where tube wide ends"):
        follow(curved([2.5, 0.0, 3.0], [2.0, 2.0, 1.0]), [NARROW, WIDE])


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (
            circle(5.0, 0.1),
            "0.4 below 0.5, where tube narrow-gentle-slow ends; tubes hold it there with a speed from 0.5 to",
        ),
        (
            circle(5.0, 100.0),
            "68 above 32, where tube narrow-gentle-fast ends; tubes hold it there with a speed from 0.5",
        ),
        (
            circle(0.5, 0.1),
            "0.4 below 0.5, where tube narrow-tight-slow ends; tubes hold it there with a speed from 0.5",
        ),
        (
            circle(0.3, 2.0),
            "1.03 above 2.3, where tube narrow-tight-slow ends; tubes hold it there with a curvature from",
        ),
        (
            circle(0.5, 100.0),
            "68 above 32, where tube narrow-tight-fast ends; tubes hold it there with a speed from 0.5",
        ),
    ],
)
def test_the_limit_that_decides_and_what_would_hold_are_told(path: Path, message: str) -> None:
    with pytest.raises(InputError) as refused:
        follow(path)
    told = str(refused.value)
    assert message in told and "\n" not in told
    assert told.endswith("; cfjax.synthesize(cfjax.Problem(path)) looks for a proof of the path's own")


def test_speeds_between_tubes_are_told_as_such() -> None:
    quick = tube("quick", speed=(3.0, 5.0))
    with pytest.raises(
        InputError, match=r"0\.5 below 3, where tube quick ends; .* a speed from 0\.5 to 2 or from 3 to 5 m/s$"
    ):
        follow(circle(2.0, 2.5), [WIDE, quick])


# --- what is no path


def test_numbers_beyond_floating_point_are_refused() -> None:
    with pytest.raises(InputError, match=r"^path endless: "):
        follow(Path("endless", (segment([(0.0,)], [(1e300,)], (0.0, 1e10)),)), [WIDE])


def test_a_path_that_runs_back_to_its_start_is_refused() -> None:
    """Its length is nearly nothing, its pieces are not: they are not cut into parts of its length."""
    module = importlib.import_module("cfjax.tubes.follow")
    back = segment([(0.0,), (0.0,)], [(1.0, -1.0), (0.0, -1.0)], (0.0, 1.0, 2.0 - 1e-3))
    assert len(module._cut(exact_reference([stated(back)])).pieces) <= module.CUTS + 2
    with pytest.raises(InputError, match=r"^path back: speed reaches -0.999 m/s"):
        follow(Path("back", (back,)), [WIDE])


def test_a_polyline_is_refused() -> None:
    first = straight(4.0, 1.0).segments[0]
    second = segment([(0.0,)], [(1.0,)], (0.0, 4.0), (0.0, 2.0, 0.0))
    with pytest.raises(
        InputError, match=r"path polyline: heading jumps by 1.57080 rad between segments 0 and 1: no car"
    ):
        follow(Path("polyline", (first, second)), [WIDE])


def test_places_and_speeds_have_to_meet() -> None:
    first = straight(4.0, 1.0).segments[0]
    apart = segment([(0.0,)], [(1.0,)], (0.0, 4.0), (-math.pi / 2, 2.0, 0.01))
    with pytest.raises(InputError, match=r"path apart: segment 1 starts 0.01\d* m away from where segment 0 ends"):
        follow(Path("apart", (first, apart)), [WIDE])
    faster = segment([(0.0,)], [(1.5,)], (0.0, 4.0), (-math.pi / 2, 2.0, 0.0))
    with pytest.raises(
        InputError, match=r"path faster: speed jumps by 0.5 m/s at theta = 0 s of segment 1, from 1 to 1.5"
    ):
        follow(Path("faster", (first, faster)), [WIDE])


def test_small_gaps_are_closed_by_integration() -> None:
    first = segment([(0.7,)], [(1.0, 0.1)], (0.0, 2.0))
    end = Pose(*map(float, first.poses(np.array([2.0]))[0]))
    second = segment([(0.7,)], [(1.2000000001,)], (0.0, 1.0), (end.alpha + 2 * math.pi, end.x + 5e-7, end.y))
    following = follow(Path("nearly", (first, second)), [WIDE])
    assert following.path.segments[1].start == pytest.approx(end, abs=1e-9)
    assert following.path.segments[1].speed.coefficients == ((1.2,),)
    assert following.path.segments[0] == first
    assert names(following) == ["wide", "wide"]


def test_a_tube_is_no_path_and_tubes_are_needed() -> None:
    with pytest.raises(InputError, match="got a tube"):
        follow(bounds(), [WIDE])
    with pytest.raises(InputError, match=r"expected one of the tubes \(none\), got none"):
        follow(circle(), [])


def test_tubes_of_two_vehicles_are_no_chain() -> None:
    foreign = dataclasses.replace(tube("foreign", 0.1, scale=2.0), vehicle="another")
    with pytest.raises(InputError, match="one vehicle"):
        follow(curved([1.0, 0.0], [4.0, 40.0]), [WIDE, foreign])


def test_a_tube_of_an_unknown_vehicle_is_no_other_one_s(tmp_path: pathlib.Path) -> None:
    document = read_json(library_files()[0])
    document["problem"]["vehicle"]["name"] = "another"
    document["hash"] = document_hash(document)
    (tmp_path / "another.json").write_text(json.dumps(document))
    tube, path = read_tube(tmp_path / "another.json"), circle(radius=2.0, speed=3.5)
    assert tube.vehicle == "another"
    assert follow(path, [tube]).start is tube
    with pytest.raises(InputError, match="is certified for another vehicle than the one given"):
        follow(path, [tube], vehicle=KinematicBicycle())


class Drifting(KinematicBicycle):
    """It inherits the name, not the dynamics."""

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        return super().twist(internal, inputs)._replace(lateral=internal[0])


def test_a_vehicle_with_dynamics_of_its_own_has_no_tubes() -> None:
    with pytest.raises(InputError, match="expected a KinematicBicycle to look for its tubes, got Drifting"):
        follow(circle(radius=1.0, speed=1.0), vehicle=Drifting())


@pytest.mark.parametrize(
    ("car", "line"),
    [
        (
            KinematicBicycle(wheelbase=0.33, max_tan_steering=0.445, max_thrust=9.5),
            "vehicle: expected a max_tan_steering of at least 0.970589 beside wheelbase 0.33, max_thrust 9.5, for the "
            "tubes are proven with such limits, got 0.445; cfjax.synthesize(",
        ),
        (KinematicBicycle(2.7, 0.5463), "vehicle: expected a max_tan_steering of at least 1 beside wheelbase 2.7"),
    ],
)
def test_a_car_without_tubes_is_told_which_limit_decides(car: KinematicBicycle, line: str) -> None:
    with pytest.raises(InputError) as caught:
        follow(circle(radius=30.0, speed=2.0), vehicle=car)
    assert line in str(caught.value)


def test_given_tubes_have_to_be_of_the_vehicle_given() -> None:
    path, tubes = circle(radius=1.0, speed=1.0), library()
    assert follow(path, tubes, vehicle=KinematicBicycle()).start in tubes
    with pytest.raises(InputError, match="is certified for another vehicle than the one given"):
        follow(path, tubes, vehicle=KinematicBicycle(0.68))


# --- chains


def test_a_link_needs_its_distance() -> None:
    # from wide to narrow V has to fall to 1/2: 1 m at 1/2 per metre
    for length, holds in ((1.001, True), (0.999, False)):
        path = curved([1.0, 0.0], [length, 50.0])
        tubes = [WIDE, NARROW]
        if holds:
            following = follow(path, tubes)
            assert names(following) == ["wide", "narrow"]
            (link,) = following.links
            assert (link.segment, link.theta) == (0, length)
            assert link.level < 0.5 and 1 < link.needed < 1.001 and link.available <= length
        else:  # it stays wide for as long as it takes, which the cuts of the straight line allow
            following = follow(path, tubes)
            assert names(following) == ["wide", "narrow"]
            assert 1.0 < following.tubes[1].start < 3.0


def test_a_link_that_is_too_short_is_refused() -> None:
    fast = tube("fast", 0.1, scale=2.0, speed=(0.5, 5.0))
    slow = tube("slow", 2.0, speed=(0.5, 1.0))

    def path(length: float) -> Path:
        return Path("short", (segment([(1.0,), (0.0,)], [(1.0,), (1.0, 1.0)], (0.0, length, length + 1.0)),))

    assert names(follow(path(1.001), [slow, fast])) == ["slow", "fast"]
    with pytest.raises(
        InputError,
        match=r"^path short: no chain of tubes: at theta = 0.999 s of segment 0 tube slow has to be left for tube fast "
        r"after 0.999 m, and fits into it after 1 m$",
    ):
        follow(path(0.999), [slow, fast])
    tiny = tube("tiny", 0.1, scale=200.0, speed=(0.5, 5.0))
    with pytest.raises(InputError, match="tube slow has to be left, and never fits into tube tiny"):
        follow(path(40.0), [slow, tiny])


def test_narrow_tubes_are_preferred_by_length() -> None:
    path = curved([0.0, 1.0, 0.0], [10.0, 3.0, 10.0])
    following = follow(path, [WIDE, NARROW])
    assert names(following) == ["narrow", "wide", "narrow"]
    assert names(follow(path, [WIDE, NARROW], pinned="wide")) == ["wide"]
    with pytest.raises(InputError, match="curvature reaches 1 1/m"):
        follow(path, [WIDE, NARROW], pinned="narrow")
    with pytest.raises(InputError, match="expected one of the tubes wide, narrow, got narow"):
        follow(path, [WIDE, NARROW], pinned="narow")
    assert following.tube_at(0, 5.0).name == "narrow" and following.tube_at(0, 12.0).name == "wide"
    assert following.start is NARROW and following.end is NARROW
    assert following.end_level == pytest.approx(max(0.01, 0.25 * math.exp(-(5 - 0.75) / 0.25)))
    with pytest.raises(InputError, match="no theta = 99"):
        following.tube_at(0, 99.0)


def test_the_chain_is_the_best_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.import_module("cfjax.tubes.follow"), "CUTS", 1)  # pieces as they are
    rng = np.random.default_rng(0)
    library = [tube("a", 2.0), tube("b", 1.2, 1.6), tube("c", 0.8, 2.3, 2.0), tube("d", 0.5, 3.7, 0.5)]
    scales = np.array([1.0, 1.6, 2.3, 3.7])
    widths, rates = 1 / np.sqrt(scales), np.array([0.5, 0.5, 1.0, 0.25])
    limits = np.array([2.0, 1.2, 0.8, 0.5])
    ratio = np.minimum(scales[:, None] / scales[None, :], 1.0)  # all shapes are similar
    below = 0.75 + 0.25 * np.log(0.25 / np.minimum(ratio, 0.25))
    needed = np.where(ratio >= 0.25, 1 - ratio, below) / rates[:, None]
    lengths_seen = set()
    for _ in range(60):
        lengths, kappas = rng.uniform(0.1, 1.5, 6).round(3), rng.uniform(0.0, 1.3, 6).round(3)
        best = math.inf
        for choice in itertools.product(range(4), repeat=6):
            if any(kappas > limits[list(choice)]):
                continue
            groups = [(i, [k for k, _ in run]) for i, run in itertools.groupby(enumerate(choice), lambda e: e[1])]
            runs = [(i, lengths[members].sum()) for i, members in groups]
            if all(length >= needed[i, j] for (i, length), (j, _) in itertools.pairwise(runs)):
                best = min(best, sum(widths[i] * length for i, length in runs))
        if math.isinf(best):
            with pytest.raises(InputError, match="no chain of tubes"):
                follow(curved(list(map(float, kappas)), list(map(float, lengths))), library)
            continue
        following = follow(curved(list(map(float, kappas)), list(map(float, lengths))), library)
        cost = sum(widths["abcd".index(s.tube.name)] * (s.end - s.start) for s in following.tubes)
        assert cost == pytest.approx(best, rel=1e-6)
        lengths_seen.add(len(following.tubes))
    assert len(lengths_seen) > 2


def test_arrival_is_bounded_by_the_timing() -> None:
    slow = dataclasses.replace(WIDE, inputs={"u0": (fmpq(1), fmpq(1))})
    assert follow(curved([0.0], [3.0]), [WIDE]).arrival == (1.5, 6.0)
    assert follow(curved([0.0], [3.0]), [slow]).arrival == (3.0, 3.0)


def test_what_is_printed_says_less() -> None:
    found = follow(curved([1.0, 0.0], [4 / 3, 50.0]), [WIDE, NARROW])
    (link,) = found.links
    text = str(found)
    printed = re.search(r"V <= (\S+) after (\S+) m, has (\S+) m", text)
    times = re.search(r"the end after (\S+) to (\S+) s", text)
    assert printed and times
    level, needed, available = map(float, printed.groups())
    assert link.level < level < link.level + 1e-5 and link.needed < needed < link.needed + 1e-5
    assert link.available - 1e-5 < available < link.available
    assert float(times[1]) < found.arrival[0] and found.arrival[1] < float(times[2])


def test_stretches_follow_the_segments() -> None:
    first = segment([(0.0,)], [(1.0,)], (0.0, 30.0))
    second = segment([(0.0,), (1.0,)], [(1.0,), (1.0,)], (0.0, 30.0, 31.0), (0.0, 0.0, 30.0))
    following = follow(Path("two", (first, second)), [WIDE, NARROW])
    assert [(s.segment, s.start, s.end, s.tube.name) for s in following.tubes] == [
        (0, 0.0, 30.0, "narrow"),
        (1, 0.0, 30.0, "narrow"),
        (1, 30.0, 31.0, "wide"),
    ]
    (link,) = following.links
    assert (link.segment, link.theta, link.needed) == (1, 30.0, 0.0)
    text = str(following)
    assert "path two: 61 m, the end after 30.5 to 122 s" in text
    assert "narrow -> wide at theta = 30 s of segment 1: V <= 1 after 0 m, has 60 m" in text


# --- laps


def test_a_circle_goes_for_ever() -> None:
    round_tube = tube("round", 0.67)
    for laps in (1.0, 3.0):
        following = follow(circle(laps=laps), [round_tube], closed=True)
        (link,) = following.links
        assert link.first is link.second is round_tube
        assert 0 < link.needed < 1e-6 and link.level <= 1
        assert following.closed and "holds for ever" in str(following)
        assert following.path.segments == circle(laps=laps).segments


def lap(rates: tuple[float, float]) -> Path:
    """A closed path by symmetry: parts that are alike, each turning by 2π/5, at a speed that rises and falls."""
    duration = 3.0
    half = duration / 2
    wanted = 2 * math.pi / LAP_PARTS
    base = wanted / duration
    turn = [(base - rates[0],), (base + rates[0],)] * LAP_PARTS
    speed = [(1.0, 0.2), (1.0 + 0.2 * half, -0.2)] * LAP_PARTS
    breaks = tuple(half * k for k in range(2 * LAP_PARTS + 1))
    return Path("lap", (segment(turn, speed, breaks, (0.3, rates[1], 0.0)),))


def test_laps_of_several_tubes_link_over_the_end() -> None:
    path = lap((0.4, 2.0))
    open_ends = segment([(0.0,), (1.0,)], [(1.0,), (1.0,)], (0.0, 30.0, 31.0))
    with pytest.raises(InputError, match="the end of the lap is not its start"):
        follow(Path("open", (open_ends,)), [WIDE, NARROW], closed=True)
    narrow = tube("narrow", 0.1, scale=2.0, margin=3.0)
    wide = tube("wide", 2.0, margin=3.0)
    following = follow(path, [wide, narrow], closed=True)
    assert names(following) == ["narrow", "wide"] * LAP_PARTS
    assert len(following.links) == 2 * LAP_PARTS
    assert (following.links[-1].segment, following.links[-1].theta) == (0, 0.0)
    assert following.links[-1].first is wide and following.links[-1].second is narrow
    # an open path needs no last link; a lap whose wide tube contracts too slowly stays in it
    lazy = tube("wide", 2.0, margin=0.05)
    assert names(follow(path, [lazy, narrow])) == ["narrow", "wide"]
    assert names(follow(path, [lazy, narrow], closed=True)) == ["wide"]


def test_a_lap_that_does_not_close_is_refused() -> None:
    following = follow(circle(laps=1 + 1e-8), [tube("round", 0.67)], closed=True)
    assert 1e-7 < following.links[0].needed < 1e-5  # what the gap costs
    with pytest.raises(InputError, match=r"path circle: the end of the lap is not its start: .* apart"):
        follow(circle(laps=1 + 1e-6), [tube("round", 0.67)], closed=True)
    faster = segment([(1.0,)], [(1.0, 1e-3)], (0.0, 2 * math.pi))
    with pytest.raises(InputError, match=r"and 0.00628 m/s apart"):
        follow(Path("faster", (faster,)), [WIDE], closed=True)


def test_a_lap_too_short_to_absorb_its_gap_is_refused() -> None:
    inert = tube("inert", 0.67, margin=1e-9)
    path = circle(laps=1 + 1e-8)
    assert not follow(path, [inert]).closed
    with pytest.raises(
        InputError, match=r"at the end of the lap tube inert has to be left for tube inert after 9.42478 m"
    ):
        follow(path, [inert], closed=True)
