"""Files of points in the forms in which people have them: read as they were meant, or refused in one line."""

from pathlib import Path as File

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle
from cfjax.problem.points import course_of, read_points
from cfjax.problem.waypoints import waypoints
from tests.written import Written, written


def check(file: File, meant: Written, whole: bool = False) -> bool:
    """Whether it is read; if so, it is what was meant, and if not, that is said in one line."""
    file.write_bytes(meant.data)
    try:
        course = course_of(read_points(file), None)
    except InputError as error:
        assert not meant.clear, (str(error), meant.forms)
        assert "\n" not in str(error) and str(error).startswith((f"{file}", "path.")), meant.forms
        return False
    place = course.points.place
    around = np.append(place, place[0]) if course.closed else place
    assert course.closed == meant.lap, (course.account, meant.forms)
    length = float(np.abs(np.diff(around)).sum())
    assert length == pytest.approx(meant.length, rel=0.02), (course.account, meant.forms)  # chords are shorter
    speed = course.points.speed
    assert (speed is None) == (meant.speed is None), meant.forms
    if speed is not None and meant.speed is not None:
        count = min(len(speed), len(meant.speed))
        np.testing.assert_allclose(speed[:count], meant.speed[:count], rtol=2e-3, err_msg=str(meant.forms))
    if whole:
        path = waypoints(file, vehicle=KinematicBicycle(wheelbase=0.1), acceleration=2.0)
        driven = sum(float(s.speed.polynomial.integrate(0, s.duration)) for s in path.curve)
        assert driven == pytest.approx(meant.length, rel=5e-3), meant.forms
        assert path.source.startswith(f"{file.name}: {len(place)} points, ") and "\n" not in path.source
    return True


@settings(
    max_examples=400, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_file_is_read_as_it_was_meant_or_refused(seed: int, tmp_path: File) -> None:
    check(tmp_path / "points.csv", written(seed), whole=seed % 16 == 0)
