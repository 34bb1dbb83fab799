"""The input box as arrays: its extreme point beats every vertex, of NumPy's arrays and within compiled code."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax import Interval
from cfjax.problem.input_box import InputBox


BOX = InputBox.of((Interval(0.5, 2.0), Interval(-1.0, 1.0), Interval(3.0, 3.0)))


def test_the_extreme_point_is_the_best_vertex() -> None:
    directions = np.random.default_rng(0).normal(size=(50, 3))
    best = (directions @ BOX.vertices.T).max(axis=1)
    np.testing.assert_allclose((directions * BOX.extreme_point(directions)).sum(axis=1), best, rtol=1e-14)
    batched = jax.jit(jax.vmap(InputBox.extreme_point, in_axes=(None, 0)))
    compiled = batched(jax.tree.map(jnp.asarray, BOX), directions)
    np.testing.assert_array_equal(compiled, BOX.extreme_point(directions))


@pytest.mark.parametrize("direction", [(0.0, 0.0, 0.0), (-0.0, 0.0, 1.0)])
def test_an_input_that_does_not_matter_stays_in_the_middle(direction: tuple[float, ...]) -> None:
    assert BOX.extreme_point(np.array(direction)).tolist() == BOX.middle.tolist() == [1.25, 0.0, 3.0]
