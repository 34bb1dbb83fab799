"""Every preset composes, builds its problem, and means what DESIGN promises."""

import numpy as np
import pytest

from cfjax.conf import config_of, options_of, preset, preset_names, problem_of, yaml_of
from cfjax.problem import Method


MEANT = {  # duration s, first and last position m, speed m/s, I and G, S
    "straight": (2.0, (-2, 0), (2, 0), 2.0, (0.5,) * 4, (1, 1, 1, 3)),
    "straight_long": (4.0, (-4, 0), (4, 0), 2.0, (0.5,) * 4, (1, 1, 1, 3)),
    "straight_restricted": (4.0, (-4, 0), (4, 0), 2.0, (0.5, 0.5, 0.5, 0.25), (1, 1, 1, 0.5)),
    "circle": (6.0, (1.5, 0), (1.5, 0), np.pi / 2, (0.5,) * 4, (1, 1, 1, 3)),
}


@pytest.mark.parametrize("name", preset_names())
def test_preset_is_what_was_promised(name: str) -> None:
    config = preset(name)
    problem, options = problem_of(config), options_of(config)
    duration, first, last, speed, inlet, safe = MEANT[name]
    (segment,) = problem.path.segments
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


@pytest.mark.parametrize("name", preset_names())
def test_configuration_survives_its_file(name: str) -> None:
    config = preset(name, ["path.speed=1.25", "sets.goal=[0.4,0.4,0.4,0.3]", "sets.safe=null", "method=tt", "seed=7"])
    again = config_of(yaml_of(config))
    assert again == config
    assert problem_of(again) == problem_of(config)


def test_user_overrides_the_sets_of_a_preset() -> None:
    problem = problem_of(preset("circle", ["sets.inlet=0.3", "sets.goal=[0.4,0.4,0.4,0.3]", "sets.safe=null"]))
    assert problem.inlet.half_axes == (0.3,) * 4
    assert problem.goal.half_axes == (0.4, 0.4, 0.4, 0.3)
    assert problem.safe is None
