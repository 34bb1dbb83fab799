"""Where cars start: random states of I, listed ones, and those at which the funnel has the least to spare."""

import csv
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.control import descent_at
from cfjax.errors import InputError
from cfjax.problem import Frame, Problem, to_state
from cfjax.simulation.loop import sample_starts
from cfjax.simulation.track import Track


CANDIDATES = 20_000  # on the boundary, at least; of 8 a car
CLIMBS, TRIES, WIDTH, NARROWER = 24, 64, 0.3, 0.8  # from each of the best: steps, directions tried in each, their size
INSIDE = 1e-12  # relative: by how much the worst starts lie inside, for rounding


def in_world(track: Track, x: Float[Array, "k n"]) -> Float[np.ndarray, "k n"]:
    """States (α, x, y, ξ…; world frame) at deviations from the start of the path."""
    place = track.at(jnp.zeros(()))
    return np.asarray(jnp.stack(to_state(track.vehicle, tuple(x.T), place.pose, place.point), axis=-1))


def random_starts(problem: Problem, track: Track, count: int, seed: int = 0) -> Float[np.ndarray, "k n"]:
    """States of I at the path's start: one half on its boundary, the other uniform in its volume."""
    return in_world(track, sample_starts(jax.random.key(seed), problem.inlet, count))


def worst_starts(track: Track, count: int, seed: int = 0) -> Float[np.ndarray, "k n"]:
    """States on the funnel's inlet, V = 1 at the path's start, where V can be made to fall least.

    The best of many by −min V̇ over the inputs, in 1/s, each of which then climbs by itself. A third of the candidates
    lie where one input, or all of them, have no authority over V: there the least is, and random points miss these
    surfaces.
    """
    return in_world(track, _worst(track, jax.random.key(seed), max(CANDIDATES, 8 * count), count))


@eqx.filter_jit
def _worst(track: Track, key: Array, tried: int, count: int) -> Float[Array, "count n"]:
    """The deviations of `worst_starts`."""
    key_sample, key_mask, key_climb = jax.random.split(key, 3)
    place = track.at(jnp.zeros(()))
    shape, n = place.numbers.shape, place.numbers.shape.shape[0]
    gradient = jax.random.normal(key_sample, (tried, n)) @ jnp.linalg.cholesky(shape).T
    zero = jax.vmap(lambda own: _rates(track, own)[1])(jnp.eye(n))[:, 1:] != 0  # by which each input acts
    pick = jax.random.randint(key_mask, (tried,), 0, 3)
    acts = jnp.any(zero, axis=1)
    one = jnp.argmax(acts)  # the first of them, the heading
    mask = jnp.where(pick[:, None] == 0, acts[None], (jnp.arange(n) == one)[None] & (pick[:, None] == 1))
    x = jnp.linalg.solve(shape, jnp.where(mask, 0.0, gradient).T).T
    level = track.template.level(place.numbers.rate, place.since)

    def on_inlet(x: Array) -> Array:
        size = jnp.einsum("...i,ij,...j->...", x, shape, x)
        return x * ((1 - INSIDE) * jnp.sqrt(level / size))[..., None]

    def climb(best: Array, now: tuple[Array, Array]) -> tuple[Array, None]:
        key, width = now
        # in parts of the funnel's half-widths; a start that nothing near it surpasses stays
        widths = jnp.sqrt(jnp.diag(jnp.linalg.inv(shape)) * level)
        turn = jax.random.normal(key, (TRIES, *best.shape)) * widths[None, None]
        tried = on_inlet(best[None] + width * turn.at[0].set(0.0))
        rates = jax.vmap(partial(least_rates, track))(tried)
        return jnp.take_along_axis(tried, jnp.argmax(rates, axis=0)[None, :, None], axis=0)[0], None

    x = on_inlet(x)
    best = x[jnp.argsort(-least_rates(track, x))[:count]]
    steps = jax.random.split(key_climb, CLIMBS), WIDTH * NARROWER ** jnp.arange(CLIMBS)
    return jax.lax.scan(climb, best, steps)[0]


@eqx.filter_jit
def least_rates(track: Track, x: Float[Array, "k n"]) -> Float[Array, " k"]:
    """min V̇ over the inputs (1/s) at deviations from the path's start."""
    return jax.vmap(lambda own: _rates(track, own)[0])(x)


def _rates(track: Track, x: Float[Array, " n"]) -> tuple[Float[Array, ""], Float[Array, " m"]]:
    """min V̇ over the inputs at a deviation from the path's start (1/s), and how each input acts on V̇."""
    place = track.at(jnp.zeros(()))
    descent = descent_at(track.vehicle, track.template, place.numbers, place.point, place.since, tuple(x))
    ends = zip(descent.slopes, descent.centre, descent.lower, descent.upper, strict=True)
    best = sum(jnp.minimum(b * (low - c), b * (high - c)) for b, c, low, high in ends)
    return jnp.asarray(descent.rate + best, float), jnp.stack([jnp.asarray(b, float) for b in descent.slopes])


def read_starts(problem: Problem, file: Path) -> Float[np.ndarray, "k n"]:
    """States (α in rad, x and y in m, ξ…; world frame) from a CSV file with a header that names them.

    A column `yaw` in place of `alpha` has headings in the frame of ROS.

    Raises:
        InputError: says which columns or which row.
    """
    frame, names = Frame.PAPER, problem.vehicle.state_names
    try:
        with file.open(encoding="utf-8", newline="") as text:
            reader = csv.DictReader(text)
            columns = [name.strip() for name in reader.fieldnames or ()]
            if Frame.ROS.heading in columns and Frame.PAPER.heading not in columns:
                frame, names = Frame.ROS, (Frame.ROS.heading, *names[1:])
            if missing := [name for name in names if name not in columns]:
                raise InputError(
                    f"--starts: expected the columns {', '.join(names)} in {file}, {missing[0]} is missing"
                )
            rows = []
            for number, row in enumerate(reader, start=2):
                own = {(key or "").strip(): value for key, value in row.items()}
                try:
                    values = [float(own[name]) for name in names]
                except (TypeError, ValueError):
                    values = [np.nan]
                if not np.isfinite(values).all():
                    raise InputError(f"--starts: expected {len(names)} finite numbers in row {number} of {file}")
                rows.append(values)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"--starts: expected random, worst or a CSV file, cannot read {file} ({reason})") from error
    if not rows:
        raise InputError(f"--starts: expected at least one state in {file}")
    return np.array(rows) - np.array([frame.shift] + [0.0] * (len(names) - 1))
