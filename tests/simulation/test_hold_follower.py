"""The law that looks one hold ahead, in the sampled loop: it acts on an old pose as on the one that it stands for."""

import itertools
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from cfjax.control.prediction import nothing_sent
from cfjax.funnel import Funnel, Leg, template_named
from cfjax.funnel.sampled import held_motion, holds
from cfjax.plants import Measurement
from cfjax.problem import Problem, ball, circle, to_state
from cfjax.problem.runge_kutta import runge_kutta
from cfjax.simulation.controller import HoldFollower, Sending
from cfjax.simulation.track import track_of
from tests.simulation.test_sampled import SHAPE


PERIOD, BEGIN = 0.04, 5.97  # s; the second hold goes over the end of the lap


def test_an_old_pose_leads_to_the_command_of_the_fresh_one() -> None:
    problem = Problem(circle(), inlet=ball(0.4))
    duration = problem.path.curve[0].duration
    funnel = Funnel(template_named("contracting"), SHAPE, 0.3005, duration)
    track = track_of(problem, [Leg(duration, funnel, 2.61)], laps=2)
    levels = [0.5, 1.0, 2.0], [-1.0, 0.2, 1.0], [-4.0, 0.0, 4.0]
    choices = np.array(list(itertools.product(*levels)))
    numbers = holds(problem, funnel, PERIOD, 3, 0.5, choices, np.zeros(len(choices)))
    follower = HoldFollower(track, numbers, PERIOD, 4)
    vehicle, point = problem.vehicle, track.at(jnp.asarray(BEGIN)).point
    rng = np.random.default_rng(0)
    held = np.column_stack([[2.0, 0.7], rng.uniform(-0.5, 0.9, 2), rng.uniform(-2, 2, 2)])

    @jax.jit
    def commands(start: jax.Array) -> list[jax.Array]:
        z, sent = jnp.concatenate([jnp.array([BEGIN]), start]), nothing_sent(4, 3)
        for inputs in jnp.asarray(held):
            motion = held_motion(vehicle, inputs, point)
            step = partial(runge_kutta, motion, h=PERIOD / 50)
            z, _ = jax.lax.scan(lambda z, _, step=step: (step(z), None), z, None, length=50)
            sent = sent.then(inputs, PERIOD)
        memory = Sending(z[0], sent)
        then, now = (
            jnp.stack(to_state(vehicle, tuple(x), track.at(theta).pose, point))
            for theta, x in ((jnp.asarray(BEGIN), start), (z[0], z[1:]))
        )
        late, fresh = jnp.asarray(0.0), jnp.asarray(2 * PERIOD)
        seen = ((then, late), (now, fresh), (then, fresh))  # the last one: an old pose that is taken for a fresh one
        return [follower.act(Measurement(*one), memory, fresh)[0] for one in seen]

    starts = rng.normal(size=(40, 4)) @ np.linalg.inv(np.linalg.cholesky(SHAPE)) * 0.4
    by_old, by_fresh, mistaken = (np.array(each) for each in jax.vmap(commands)(jnp.asarray(starts)))
    np.testing.assert_allclose(by_old, by_fresh, atol=1e-12)
    assert (np.abs(mistaken - by_fresh).max(axis=1) > 0.1).sum() > 5
    assert len(np.unique(by_fresh.round(6), axis=0)) > 3


def test_theta_goes_on_with_the_input_that_is_held() -> None:
    problem = Problem(circle(), inlet=ball(0.4))
    duration = problem.path.curve[0].duration
    funnel = Funnel(template_named("contracting"), SHAPE, 0.3005, duration)
    track = track_of(problem, [Leg(duration, funnel, 2.61)])
    choices = np.array([[0.5, 0.2, 0.0], [2.0, 0.2, 0.0]])
    numbers = holds(problem, funnel, PERIOD, 3, 0.5, choices, np.zeros(2))
    follower = HoldFollower(track, numbers, 0.01, 4)
    place = track.at(jnp.asarray(1.0))
    ahead = jnp.stack(to_state(problem.vehicle, (0.0, 0.0, 0.5, 0.0), place.pose, place.point))
    memory = follower.start(ahead, jnp.asarray(1.0))
    _, after = follower.act(Measurement(ahead, jnp.asarray(0.0)), memory, jnp.asarray(0.0))
    assert float(follower.theta(after)) == 1.0 + 0.01 * float(after.sent.inputs[0, 0])
    assert float(after.sent.lengths[0]) == 0.01
    assert float(after.sent.inputs[0, 0]) == 2.0  # a car that is ahead lets its reference come after
