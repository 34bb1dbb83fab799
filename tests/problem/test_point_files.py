"""Files of points in the forms in which people have them: read as they were meant, or refused in one line."""

from pathlib import Path as File
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle
from cfjax.problem.point_path import waypoints
from cfjax.problem.points import read_points
from cfjax.problem.route import route_of
from experiments.vehicles.unicycle import Unicycle
from tests.written import Written, written


CASES = File(__file__).parents[1] / "cases"
CAR = KinematicBicycle(wheelbase=0.33)
FUZZ = settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])


def length(path) -> float:
    return sum(float(segment.speed.polynomial.integrate(0, segment.duration)) for segment in path.curve)


# --- files that people brought

LAP = r"closed, 2 m/s \(no speed is given\), smallest radius 1.67 m"
READ = {
    "raceline_semicolon": r"72 points, 22.0 m, closed, 2 m/s, smallest radius 1.67 m, columns x_m, y_m, vx_mps; s_m",
    "decimal_comma": rf"72 points, 22.0 m, {LAP}, columns x, y",
    "units_mm": r"72 points, 22.0 m, closed, 2 m/s \(no .* given\), smallest radius 1.63 m, columns x_mm, y_mm",
    "speed_kmh": r"72 points, 22.0 m, closed, 2 m/s, smallest radius 1.67 m, columns x, y, speed_kmh",
    "nearly_closed_1mm": rf"72 points, 22.0 m, {LAP.replace('closed', r'closed .gap 0.92 mm.')}, columns x, y",
    "not_repeated_widths": (
        r"72 points, 22.0 m, closed \(gap 0.301 m, the first .*; w_tr_right_m, w_tr_left_m used with "
        r"sets\.corridor=file only"
    ),
}
NO_PATH = {
    "third_time": r": expected a speed in m/s in the third column.* time stamps\?; name the columns .*path\.columns=\[",
    "gps_noise_2cm": r", row \d+: after .* radius of 0\.\d+ m.* path\.smoothing=0\.02 \(m, past the points\) does it$",
    "rounded_cm": r", row \d+: after .* radius of 0\.\d+ m.* path\.smoothing=0\.005 \(m, past the points\) does it$",
    "stop_at_ends": r": expected a unit of velocity.* path\.columns=\[x,y,_,_,speed_kmh,_\] says so",
    "cusp_reverse": r", row 32: the path turns back on itself at x = 3 m, y = 0\.9 m \(a cusp\)",
}


@pytest.mark.parametrize("name", READ)
def test_what_can_be_read_is_said_in_one_line(name: str) -> None:
    path = waypoints(CASES / f"{name}.csv", vehicle=CAR)
    assert pytest.approx(22.03, abs=0.02) == length(path)
    assert path.closed
    assert pl.Series([path.source]).str.contains(rf"^{name}\.csv: {READ[name]}").item()


@pytest.mark.parametrize("name", NO_PATH)
def test_what_cannot_be_read_is_refused_with_a_way_out(name: str) -> None:
    file = CASES / f"{name}.csv"
    with pytest.raises(InputError, match=rf"^{file}{NO_PATH[name]}") as raised:
        waypoints(file, vehicle=CAR)
    assert "\n" not in str(raised.value)


def test_the_ways_out_are_ways_out() -> None:
    for name, keys in (
        ("gps_noise_2cm", {"smoothing": 0.02}),
        ("rounded_cm", {"smoothing": 0.005}),
        ("stop_at_ends", {"columns": ["x", "y", "_", "_", "speed_kmh", "_"], "least_speed": 1.0}),
        ("third_time", {"columns": ["x", "y", "time"]}),
        ("nearly_closed_1mm", {"closed": True}),
    ):
        path = waypoints(CASES / f"{name}.csv", vehicle=CAR, **keys)
        assert path.closed and length(path) == pytest.approx(22.03, abs=0.05)
        assert max(segment.speed.polynomial(0.0) for segment in path.curve) <= 2.0
    with pytest.raises(InputError, match=r"row 2: expected a positive speed, got 0, .*; path\.least_speed=1 drives"):
        waypoints(CASES / "stop_at_ends.csv", vehicle=CAR, columns=["x", "y", "_", "_", "speed_kmh", "_"])


def test_a_lap_of_two_kilometres() -> None:
    course = route_of(read_points(CASES / "full_size_2km.csv"), None)
    assert course.closed and len(course.points.place) == 460 and "5.56 m, the first point follows" in course.account


# --- forms

ARC = "0 0,4 0,8 1,12 3,15 6"
FORMS = {  # texts, each of points on ARC, and the speed that they mean in m/s
    "x,y\n{,}": None,
    "sep=;\nx;y\n{;}": None,
    "\n\n# of a planner, made by hand\n% x y\nX | Y\n{|}": None,
    "my track\n\nx\ty\n{\t}": None,
    "{ }": None,
    "x y\n{ }  ": None,
    '"x [m]" "y [m]"\n{ }': None,
    "x [m] y [m]\n{ }": None,
    "id,x,y,name\n{#,|,a}": None,
    "time,pose.position.x,pose.position.y,pose.orientation.x,pose.orientation.y\n{#,|,0,0}": None,
    "x,y,x_left,y_left,x_right,y_right\n{,|,9,9,9,9}": None,
    "# x_m, y_m, vx_mps\n{,|,3}": 3.0,
    "x,y,v\nm,m,km/h\n{,|,36}": 10.0,
    "x,y,v\n[m],[m],[km/h]\n{,|,36}": 10.0,
    "x_mm,y_mm,v_km_h\n{,|,36|e3}": 10.0,
    "posX (cm);posY (cm);Speed [mph]\n{;|;10|e2}": 4.4704,
    "x (in cm),y (in cm),v (in km/h)\n{,|,36|e2}": 10.0,
    "East,North,velocity\n{,|,2.5}": 2.5,
    "x in km,y in km,speed m/s\n{,|,2|e-3}": 2.0,
    "xm,ym,vkmh\n{,|,7.2}": 2.0,
    "x;y;v\n{;|;2,5|comma}": 2.5,
    '"x","y"\n{"}': None,
    "#\tx\ty\n{\t}": None,
    "{,|,2.0}": 2.0,
}


def in_form(text: str) -> str:
    head, _, form = text.rstrip(" }").partition("{")
    points = [tuple(map(float, point.split())) for point in ARC.split(",")]
    scale = 1.0
    if form.count("|") and form[-3:].lstrip("|").startswith("e"):
        form, _, power = form.rpartition("|")
        scale = float(f"1{power}")
    comma = form.endswith("|comma")
    form = form.removesuffix("|comma")
    lines = []
    for index, (x, y) in enumerate(points):
        cells = [f"{x * scale:.6f}", f"{y * scale:.6f}"]
        if comma:
            cells = [cell.replace(".", ",") for cell in cells]
        if form == '"':
            lines.append(",".join(f'"{cell}"' for cell in cells))
        elif form == "#,|,a":
            lines.append(f"{index},{cells[0]},{cells[1]},a")
        elif len(form) < 2:
            lines.append((form or " ").join(cells))
        else:
            separator = ";" if form.startswith(";") else ","
            line = separator.join(cells) + form.partition("|")[2]
            lines.append(f"{index}{separator}{line}" if form.startswith("#") else line)
    return head + "\n".join(lines) + "\n"


@pytest.mark.parametrize("form", FORMS)
def test_forms_of_one_path(form: str, tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    file.write_text(in_form(form))
    points = read_points(file)
    expected = [complex(*map(float, point.split())) for point in ARC.split(",")]
    np.testing.assert_allclose(points.place, expected, rtol=0, atol=1e-8)
    if FORMS[form] is None:
        assert points.speed is None
    else:
        np.testing.assert_allclose(points.speed, FORMS[form], rtol=1e-12)


REFUSED = {
    "x_left,y_left,x_right,y_right\n0,0,1,0\n0,1,1,1\n": r"got x_left, y_left, x_right, y_right: name the two",
    "x,y,v,speed\n0,0,1,1\n1,0,1,1\n": r": expected one column of the speed, got v, speed",
    "x,y,vx,vy\n0,0,1,0\n1,0,1,0\n": r": expected one column of the speed, got vx and vy, components",
    "x_px,y_px\n0,0\n10,0\n": r": expected a length in m, mm, .*, got the column x_px",
    "x [parsec],y [parsec]\n0,0\n1,0\n": r": expected a length in m, mm, .*, got the column x \[parsec\]",
    "x,y,speed [rpm]\n0,0,5\n1,0,5\n": r": expected a speed in m/s, .*, got the column speed \[rpm\]",
    "x_mm,y\n0,0\n1000,0\n": r": expected units of both or of none, got the columns x_mm and y",
    "x_mm,y_mm,v\n0,0,500\n1000,0,500\n": r": expected a unit of the speed beside x_mm, got v: write v_mps",
    "x,y,v\n0,0,300\n1,0,300\n": r": expected at most 120 m/s in the column v, got 300: say its unit",
    "# units: mm\nx,y\n0,0\n4000,0\n": r"row 1 speaks of mm: expected the unit in the names .* x_mm,y_mm",
    "# v in kph\nx,y,v\n0,0,5\n1,0,5\n": r"row 1 speaks of kph: expected the unit in the name .* as speed_kph",
    "# speed in km/h\nx_m,y_m,speed\n0,0,5\n1,0,5\n": r"row 1 speaks of kmh: expected the unit in .* speed_kmh",
    "x,y\n0,0\n4000,0\n# all in mm\n": r"row 4 speaks of mm: expected the unit in the names of columns, as x_mm,y_mm",
    "0,0\n# cm from here\n400,0\n800,1\n": r"row 2 speaks of cm: expected the unit in the names",
    "x,y # in cm\n0,0\n400,0\n": r"row 1 speaks of cm: expected the unit in the names",
    "x_m,y_m,v\n0,0,5\n1,0,5\n# v: km/h\n": r"row 4 speaks of kmh: expected the unit in the name of the speed's",
    "latitude;longitude\n48.1;11.5\n48.2;11.6\n": r"row 1: expected x and y in m, got latitude and longitude: project",
    "# lon, lat\n48.1,11.5\n48.2,11.6\n": r"row 1: expected x and y in m, got latitude and longitude: project",
    "x,y\n4,0589,0,0000\n4,0341,0,3000\n": r"row 1 names 2 columns, row 2 has 4 \(a decimal comma needs another",
    "0,4.1,0.2\n1,4.3,0.4\n2,4.5,0.5\n3,4.7,0.4\n": r"in the first column, which has no name, got the numbers of",
    "0.1,4.1,9.2\n0.2,4.3,9.4\n0.3,4.5,9.5\n0.4,4.7,9.4\n": r"without names, got time, x and y as likely",
    "0,0,0\n1,0,0\n2,1,0\n": r": expected a speed in m/s in the third column, .*: a heading, a curvature or a height\?",
    "0,0,0.1\n1,0,-0.2\n2,1,0.1\n": r": expected a speed in m/s .*: a heading, a curvature or a height\?",
    "0,0,1\n1,0,2\n2,1,3\n": r": expected a speed in m/s .* which never turns back: time, or the way driven\?",
    "0,0,0.7854\n1,1,0.7854\n2,2,0.7854\n": r": expected a speed in m/s .*, which turns with the path: a heading\?",
    "1,2,3,4\n5,6,7,8\n": r"row 1: expected .*; name the columns in a header, or by path\.columns",
    "x,y,v\n0,0,0\n1,0,0\n2,0,0\n": r": expected a positive speed, got 0 in all rows",
    "x,y\n0,0\n1.5,2,5\n": r"expected a name for each column, but row 1 names 2 columns",
    "x;y\n1.234,5;1\n2.345,6;2\n": r"row 2: expected .*; got 1\.234,5;1 \(numbers with signs for thousands\?\)$",
    "x,y\n0,0\n0.003,0.001\n": r": expected points in m that suit a wheelbase of 0\.34 m, got 0\.003162 m in all: say",
    "x,y\n" + "".join(f"{300 * i},{i}\n" for i in range(30)): r"got 300 m between points: .* as in x_mm,y_mm or x_m",
}


def arc(turn: float, radius: float, count: int = 30) -> np.ndarray:
    return radius * np.exp(1j * np.linspace(0, turn, count))


def rows_of(place: np.ndarray, third: np.ndarray | float) -> str:
    values = zip(place.real, place.imag, np.broadcast_to(third, place.shape), strict=True)
    return "".join(f"{x:.6f},{y:.6f},{z:.6f}\n" for x, y, z in values)


def test_a_third_column_that_may_be_a_curvature_is_refused(tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    bend = arc(3.0, 4.0)
    run = 8 * np.arange(1, 9) / 8
    both = np.concatenate([bend[0] - 1j * run[::-1], bend])  # a straight way and a bend
    for place, third in ((bend, 0.25), (both, np.where(np.arange(len(both)) < 8, 0.0, 0.25))):
        file.write_text(rows_of(place, third))
        with pytest.raises(InputError, match=r"as the path bends \(1/m\): its curvature\?; name the col"):
            waypoints(file)
        assert not waypoints(file, columns=["x", "y", "_"]).curve[0].speed.polynomial(0.0) < 1
    file.write_text(rows_of(bend, 1.5))  # a speed, or a width: what it is taken for is said
    assert "3 (taken for a speed in m/s: path.columns=[x,y,_] where it is none)" in waypoints(file).source


SPEEDS = (
    "v_rad_s v_deg_s v_dm_s kmh_speed speed_kmh_ref speed_mph_limit speed_x100 speed(m/s)*10 v_m_s2 speed_kmperhour",
    "v kmh target",
    "speed kilometers per hour",
)
LENGTHS = ["cm_x", "x_cm_ref", "x_10cm", "x_ft_us", "x_cell", "x_grid"]
HIDDEN = [f"x,y,{name}\n0,0,5\n1,0,5\n" for name in [*SPEEDS[0].split(), *SPEEDS[1:]]]
HIDDEN += [f"{x},{x.replace('x', 'y')}\n0,0\n1,0\n" for x in LENGTHS]


@pytest.mark.parametrize("text", HIDDEN)
def test_a_unit_that_is_not_understood_is_not_passed_over(text: str, tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=r": expected a (speed|length) (in|whose unit) .*, got the column "):
        waypoints(file)


@pytest.mark.parametrize("names", ["x,y,speed_ref", "x,y,v_target", "wp_x_1,wp_y_1,vx_mps", "px,py,speed_mps"])
def test_other_words_beside_a_name_are_no_units(names: str, tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    comment = "# not in km/h\n" if "mps" in names else ""
    file.write_text(f"{comment}{names}\n0,0,2\n4,0,2\n")
    assert waypoints(file).curve[0].speed.coefficients[0][0] == pytest.approx(2)


def test_a_least_speed_needs_speeds() -> None:
    with pytest.raises(InputError, match=r"path\.least_speed: expected points with speeds, got none"):
        waypoints([(0, 0), (4, 0)], least_speed=1)


@pytest.mark.parametrize("text", REFUSED)
def test_what_may_be_meant_otherwise_is_refused(text: str, tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=REFUSED[text]) as raised:
        waypoints(file)
    assert str(raised.value).startswith(str(file)) and "\n" not in str(raised.value)


def test_names_may_be_given_instead_of_a_header(tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    file.write_text("time,wp\n1,0,0,36\n2,4000,0,18\n3,8000,1000,18\n")
    points = read_points(file, ["t", "x_mm", "y_mm", "v_kmh"])
    np.testing.assert_allclose(points.place, [0, 4, 8 + 1j])
    np.testing.assert_allclose(points.speed, [10, 5, 5])
    for columns, message in (
        (["x", "y"], "expected a name for each of 4 columns, got x, y"),
        (["a", "b", "c", "d"], "expected a name for x and one for y, got a, b, c, d"),
        (["x", "y", "x", "y"], "expected one column of x and one of y, got x, y, x, y"),
    ):
        with pytest.raises(InputError, match=rf"^path\.columns: {message}"):
            read_points(file, columns)


def test_no_table_gets_one_line(tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    for data, message in (
        (b"PK\x03\x04....", r"got a spreadsheet or an archive: save it as CSV$"),
        (b"\x93NUMPY\x01\x00", r"got an array of NumPy: save it as CSV$"),
        (b"1,2\n3,\x004\n", r"it cannot be read \(it is not text\)$"),
    ):
        file.write_bytes(data)
        with pytest.raises(InputError, match=message) as raised:
            read_points(file)
        assert "\n" not in str(raised.value)


def test_points_that_are_too_large_or_small_for_the_car_are_doubted() -> None:
    lap = arc(2 * np.pi, 4.0, 60)
    assert waypoints(lap, vehicle=CAR).doubt == "" == waypoints(6 * lap, vehicle=KinematicBicycle(2.7)).doubt
    doubt = waypoints(10 * lap, vehicle=CAR).doubt
    assert doubt.startswith("points: 251 m are 762 wheelbases (0.33 m), its tightest bend has a radius of 121: where")
    assert doubt.endswith("or by 'path.columns=[x_cm,y_cm]'; x_m,y_m where they are") and "\n" not in doubt
    assert " m), its points are 69.9 apart: " in waypoints(np.linspace(0, 900, 40) + 0j, vehicle=CAR).doubt
    for unit, radius in (("dm", 4.0), ("m", 40.0)):
        path = waypoints({f"x_{unit}": 10 * lap.real, f"y_{unit}": 10 * lap.imag}, vehicle=CAR)
        assert path.doubt == "" and length(path) == pytest.approx(2 * np.pi * radius, rel=1e-3)
    with pytest.raises(InputError, match=r"; 1\.2\d m in all are 3\.\d+ wheelbases: are the points in m\?$"):
        waypoints(0.05 * lap, vehicle=CAR)


def test_a_smoothing_that_takes_the_path_away_is_refused() -> None:
    lap = arc(2 * np.pi, 4.0, 60)
    with pytest.raises(InputError, match=r"^path\.smoothing: expected at most 0\.4\d* m for points that lie 4"):
        waypoints(lap, smoothing=100)
    assert length(waypoints(lap, smoothing=0.3)) == pytest.approx(8 * np.pi, rel=0.1)


def test_what_is_known_of_a_bicycle_alone_is_refused_for_others() -> None:
    with pytest.raises(InputError, match=r"path\.reserve: expected none for a unicycle, of whose .*, got 0\.3$"):
        waypoints(arc(1.0, 4.0), vehicle=Unicycle(), reserve=0.3)
    assert waypoints(arc(1.0, 4.0), vehicle=Unicycle())


def test_what_is_no_file_gets_one_line(tmp_path: File) -> None:
    with pytest.raises(InputError, match=r"^points: expected the name of a file, got an empty text$"):
        waypoints("")
    with pytest.raises(InputError, match=r": expected a CSV file of waypoints, got a folder$"):
        waypoints(tmp_path)
    with pytest.raises(
        InputError, match=r": expected a CSV file of waypoints, it cannot be read \(File name too long\)$"
    ):
        waypoints("a" * 5000)
    with pytest.raises(InputError, match=r"it cannot be read \(a file's name has no zero bytes\)$"):
        waypoints("a\0b")


# --- laps


def lap(count: int = 40) -> np.ndarray:
    return 4 * np.exp(2j * np.pi * np.arange(count) / count)


LAPS = {
    "repeated": (np.append(lap(), lap()[0]), 40, "closed"),
    "not repeated": (lap(), 40, "closed (gap 0.628 m, the first point follows the last)"),
    "nearly": (np.append(lap(), lap()[0] * 1.0005), 40, "closed (gap 2 mm)"),
    "nearly, with noise": (np.append(lap(), lap()[0] + 0.1), 40, "closed (gap 0.100 m)"),
    "beyond": (np.append(lap(), lap()[:6]), 40, "closed (runs 3.14 m beyond its start, which is cut off)"),
    "three times": (np.concatenate([lap()] * 3), 40, "closed (runs 49.6 m beyond its start, which is cut off)"),
    "three quarters": (lap()[:30], 30, "open (ends 6.08 m apart)"),
    "there and back": (np.array([0, 1, 2, 3, 4, 4 + 1j, 3 + 1j, 2 + 1j, 1 + 1j, 1j]), 10, "open (ends 1.00 m apart)"),
    "a lane beside": (np.concatenate([lap(), 1.2 * lap()[:10]]), 50, "open (ends 5.75 m apart)"),
}


@pytest.mark.parametrize("name", LAPS)
def test_a_lap_is_recognised_by_where_it_ends(name: str) -> None:
    place, count, account = LAPS[name]
    course = route_of(read_points(place), None)
    assert (course.account, len(course.points.place)) == (account, count)
    assert course.closed == account.startswith("closed")
    assert not route_of(read_points(place), False).closed
    assert route_of(read_points(place), True).closed


def test_a_corner_where_the_lap_closes_is_named() -> None:
    u = np.linspace(0, np.pi / 2, 60)
    petal = 4 * np.sin(2 * u) * np.exp(1j * u)  # with a corner where it begins
    petal[-1] = petal[0]
    with pytest.raises(InputError, match=r"^points\[\d+\]: after .* \(where the lap closes\), the path"):
        waypoints(petal, vehicle=CAR)


# --- points in memory

POINTS = np.array([[0, 0, 2], [4, 0, 1], [8, 1, 2], [12, 3, 2.5]], dtype=float)


class Frame:
    """As much of a pandas data frame as matters here."""

    columns = ("x", "y", "label", "v")

    def __getitem__(self, name: str) -> list:
        return {"x": [0, 4, 8, 12], "y": [0, 0, 1, 3], "label": list("abcd"), "v": [2, 1, 2, 2.5]}[name]


MEMORY = {
    "array": POINTS,
    "integers": np.rint(POINTS[:, :2]).astype(int),
    "list": POINTS.tolist(),
    "tuples": tuple(map(tuple, POINTS[:, :2])),
    "complex": POINTS[:, 0] + 1j * POINTS[:, 1],
    "mapping": {"speed": POINTS[:, 2], "y": POINTS[:, 1], "x": POINTS[:, 0]},
    "km/h": {"x_mm": 1e3 * POINTS[:, 0], "y_mm": 1e3 * POINTS[:, 1], "v_kmh": 3.6 * POINTS[:, 2]},
    "polars": pl.DataFrame(POINTS, schema=["x", "y", "speed"]).with_columns(name=pl.lit("a")),
    "frame": Frame(),
    "structured": np.array([tuple(row) for row in POINTS], dtype=[("x", float), ("y", float), ("v", "f8")]),
}


@pytest.mark.parametrize("name", MEMORY)
def test_points_in_memory(name: str) -> None:
    points = read_points(MEMORY[name])
    np.testing.assert_allclose(points.place, POINTS[:, 0] + 1j * POINTS[:, 1], atol=1e-12)
    if points.speed is not None:
        np.testing.assert_allclose(points.speed, POINTS[:, 2], atol=1e-12)
    assert (points.speed is None) == (name in ("integers", "tuples", "complex"))


def test_points_in_memory_make_the_path_of_the_file(tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    file.write_text("x,y,speed\n" + "".join(f"{x},{y},{v}\n" for x, y, v in POINTS.tolist()))
    path = waypoints(POINTS)
    assert path == waypoints(file)
    assert path.source.startswith("points: 4 points, 12.6 m, open (ends 12.4 m apart), 1 to ")
    assert waypoints(POINTS[:, [2, 1, 0]], columns=["v", "y", "x"]) == path


@pytest.mark.parametrize(
    "wrong",
    [
        *(None, 3, 2.5, True, 1j, object(), int, len, b"0,0", set(), [], {}, (), [[]], [1, 2, 3], [[1, 2]], [[1], [2]]),
        *([["a", "b"], ["c", "d"]], [[1, 2], [3]], {"x": [1, 2]}, {"x": [1, 2], "y": [1]}, {"lat": [1], "lon": [2]}),
        *(
            np.zeros((2, 40)),
            np.zeros((5, 4)),
            np.zeros((2, 2, 2)),
            np.full((3, 2), np.nan),
            np.zeros((3, 2)),
            pl.DataFrame,
        ),
        *(np.array(["2020-01-01"], dtype="datetime64[s]"), pl.DataFrame({"x": ["a"], "y": ["b"]}), CAR, pl.DataFrame),
    ],
    ids=lambda value: f"{type(value).__name__}",
)
def test_what_is_no_points_gets_one_line(wrong: Any) -> None:
    with pytest.raises(InputError, match=r"^points") as raised:
        waypoints(wrong)
    assert "\n" not in str(raised.value) and len(str(raised.value)) < 300


# --- fuzzing


def check(file: File, meant: Written, whole: bool = False) -> bool:
    """Whether it is read; if so, it is what was meant, and if not, that is said in one line."""
    file.write_bytes(meant.data)
    try:
        course = route_of(read_points(file), None)
    except InputError as error:
        said = str(error)
        if meant.clear or "\n" in said or not said.startswith((str(file), "path.")):
            raise AssertionError(said, meant.forms) from error
        return False
    place = course.points.place
    around = np.append(place, place[0]) if course.closed else place
    assert course.closed == meant.lap, (course.account, meant.forms)
    measured = float(np.abs(np.diff(around)).sum())
    assert measured == pytest.approx(meant.length, rel=0.02), (course.account, meant.forms)  # chords are shorter
    speed = course.points.speed
    assert (speed is None) == (meant.speed is None), meant.forms
    if speed is not None and meant.speed is not None:
        count = min(len(speed), len(meant.speed))
        np.testing.assert_allclose(speed[:count], meant.speed[:count], rtol=2e-3, err_msg=str(meant.forms))
    if whole:
        spacing = float(np.median(np.abs(np.diff(place))))
        path = waypoints(file, vehicle=KinematicBicycle(wheelbase=max(0.1, spacing / 100)), acceleration=2.0)
        assert length(path) == pytest.approx(meant.length, rel=5e-3), meant.forms
        assert path.source.startswith(f"{file.name}: {len(place)} points, ") and "\n" not in path.source
    return True


@settings(FUZZ, max_examples=200)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_file_is_read_as_it_was_meant_or_refused(seed: int, tmp_path: File) -> None:
    check(tmp_path / "points.csv", written(seed), whole=seed % 32 == 0)


PIECES = st.sampled_from(
    ["1", "2.5", "-3", "0,5", "x", "y", "v", "_mm", ",", ";", "\t", " ", "\n", '"', "#", "[m]", "nan"]
)


@settings(FUZZ, max_examples=300)
@given(data=st.lists(PIECES, max_size=40).map(lambda pieces: "".join(pieces).encode()) | st.binary(max_size=60))
def test_no_bytes_get_anything_but_points_or_one_line(data: bytes, tmp_path: File) -> None:
    file = tmp_path / "points.csv"
    file.write_bytes(data)
    try:
        course = route_of(read_points(file), None)
    except InputError as error:
        said = str(error)
    else:
        said, place = course.account, course.points.place
        assert len(place) >= 2 and np.isfinite(place).all() and (np.abs(np.diff(place)) > 0).all()
    assert "\n" not in said and "\r" not in said
