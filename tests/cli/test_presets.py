"""Every preset composes, builds its problem, and means what DESIGN promises."""

import numpy as np
import pytest

from cfjax.conf import config_of, options_of, preset, preset_names, problem_of, yaml_of
from cfjax.problem import Method, Segment, Tube


MEANT = {  # duration s, first and last position m, speed m/s, I and G, S
    "straight": (2.0, (-2, 0), (2, 0), 2.0, (0.5,) * 4, (1, 1, 1, 3)),
    "straight_long": (4.0, (-4, 0), (4, 0), 2.0, (0.5,) * 4, (1, 1, 1, 3)),
    "straight_restricted": (4.0, (-4, 0), (4, 0), 2.0, (0.5, 0.5, 0.5, 0.25), (1, 1, 1, 0.5)),
    "circle": (6.0, (1.5, 0), (1.5, 0), np.pi / 2, (0.5,) * 4, (1, 1, 1, 3)),
}


CURVES = [name for name in preset_names() if name != "tube"]


@pytest.mark.parametrize("name", CURVES)
def test_preset_is_what_was_promised(name: str) -> None:
    config = preset(name)
    problem, options = problem_of(config), options_of(config)
    duration, first, last, speed, inlet, safe = MEANT[name]
    (segment,) = problem.path.segments
    assert isinstance(segment, Segment)
    assert segment.duration == pytest.approx(duration, rel=1e-12)
    poses = segment.poses(np.array([0.0, segment.duration]))
    np.testing.assert_allclose(poses[:, 1:], [first, last], atol=1e-9)
    assert segment.point(0.0).speed == pytest.approx(speed, rel=1e-15)
    assert problem.path.name == name
    assert problem.inlet.half_axes == problem.goal.half_axes == inlet
    assert problem.safe is not None
    assert problem.safe.half_widths == safe
    assert problem.method is Method.PF
    assert (problem.timing.lower, problem.timing.upper) == (0.5, 2.0)
    assert problem.vehicle.wheelbase == 0.34  # pyright: ignore[reportAttributeAccessIssue]
    assert (options.template, options.beta_lower) == ("contracting", 0.9)


def test_tube_is_what_was_promised() -> None:
    """A number or an interval of each; I is a ball of 0.4 and G one of 0.6."""
    given = ["path.speed=[1.8,2.2]", "path.curvature=[-1.8,1.5]", "path.acceleration=[-1,0.5]"]
    for overrides, bounds in (
        (["path.speed=2", "path.curvature=1.8"], ((2.0, 2.0), (-1.8, 1.8), (0.0, 0.0))),
        (given, ((1.8, 2.2), (-1.8, 1.5), (-1.0, 0.5))),
    ):
        problem = problem_of(preset("tube", overrides))
        (bound,) = problem.path.segments
        assert isinstance(bound, Tube)
        found = [(interval.lower, interval.upper) for interval in (bound.speed, bound.curvature, bound.acceleration)]
        assert tuple(found) == bounds
        assert (problem.inlet.half_axes, problem.goal.half_axes, problem.safe) == ((0.4,) * 4, (0.6,) * 4, None)
        assert bound.duration == np.inf


@pytest.mark.parametrize("name", preset_names())
def test_configuration_survives_its_file(name: str) -> None:
    sets = ["sets.inlet=0.2", "sets.goal=[0.4,0.4,0.4,0.3]", "sets.safe=null"]
    config = preset(name, ["path.speed=1.25", *sets, "method=tt", "seed=7", "objective=width", "objective.margin=0.5"])
    again = config_of(yaml_of(config))
    assert again == config
    assert problem_of(again) == problem_of(config)


def test_user_overrides_the_sets_of_a_preset() -> None:
    problem = problem_of(preset("circle", ["sets.inlet=0.3", "sets.goal=[0.4,0.4,0.4,0.3]", "sets.safe=null"]))
    assert problem.inlet.half_axes == (0.3,) * 4
    assert problem.goal.half_axes == (0.4, 0.4, 0.4, 0.3)
    assert problem.safe is None
