"""The gradient learner: feasible answers, no recompilation, and what it says where there is no room."""

import itertools

import numpy as np
import pytest

from cfjax.falsifier.minimax import Schedule, _run
from cfjax.funnel import TEMPLATES
from cfjax.learner import learn
from cfjax.problem import Box, Ellipsoid, Method, Problem, ball, circle, straight
from cfjax.problem.traced_vehicle import traced_vehicle
from cfjax.traced import traced


S = Box((1.0, 1.0, 1.0, 3.0))


def test_schedule_parts_join() -> None:
    schedule = Schedule(900, (0.1, 1e-3), (1.0, 0.01), (0.2, 2e-4))
    parts = [schedule.part(k, 3, 0.0) for k in range(3)]
    assert [part.steps for part in parts] == [300] * 3
    for before, after in itertools.pairwise(parts):
        assert before.learning_rate[1] == pytest.approx(after.learning_rate[0])
        assert before.temperature[1] == pytest.approx(after.temperature[0])
    assert parts[0].learning_rate[0] == 0.1
    assert parts[-1].step[1] == pytest.approx(2e-4)


@pytest.mark.parametrize("template", TEMPLATES.values(), ids=lambda t: t.name)
def test_learned_funnel_satisfies_the_containments(template) -> None:
    problem = Problem(circle(radius=2.0, speed=1.0), inlet=Ellipsoid((0.3, 0.4, 0.4, 0.3)), goal=ball(0.45), safe=S)
    segment = problem.path.segments[0]
    learned = learn(problem, template, seed=3)
    assert learned is not None and learned.margin > 0 > learned.excess
    shape, end = learned.funnel.shape, float(learned.funnel.level(segment.duration))
    assert np.linalg.eigvalsh(problem.inlet.shape - shape).min() > 0  # (a)
    assert np.linalg.eigvalsh(shape - end * problem.goal.shape).min() > 0  # (b)
    assert (np.diag(np.linalg.inv(shape)) < np.square(S.half_widths)).all()  # (c)


def test_one_program_serves_every_path_and_method() -> None:
    template, sizes = TEMPLATES["paper"], []
    for problem in (Problem(circle(), safe=S), Problem(straight(), method=Method.TT), Problem(circle(speed=3.0))):
        learn(problem, template)
        sizes.append(len(traced(_run, traced_vehicle(problem.vehicle), template).programs))
    assert sizes[0] == sizes[1] == sizes[2]


def test_same_seed_same_funnel() -> None:
    problem = Problem(straight(), safe=S, method=Method.TT)
    first, second = (learn(problem, TEMPLATES["paper"], seed=5) for _ in range(2))
    assert first is not None and second is not None
    np.testing.assert_array_equal(first.funnel.shape, second.funnel.shape)
    assert first.margin == second.margin


def test_no_room_is_said() -> None:
    """G inside I by more than a funnel of this template may shrink: (b) cannot hold."""
    problem = Problem(straight(), inlet=ball(0.5), goal=ball(1e-3), safe=S, method=Method.TT)
    assert learn(problem, TEMPLATES["paper"]) is None
