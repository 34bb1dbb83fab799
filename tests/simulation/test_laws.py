"""Laws of a question and controllers of the same names say the same, by two ways to the place beside the car."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.baselines import PurePursuit, Stanley
from cfjax.baselines.geometric import nearest
from cfjax.problem import PurePursuitLaw, StanleyLaw, circle, straight
from cfjax.problem.feedback import LawContext
from cfjax.problem.geometric_laws import GeometricLaw
from cfjax.simulation.track import Track
from tests.simulation.test_baselines import course, state_at


DEVIATIONS = np.random.default_rng(5).uniform(-0.25, 0.25, (64, 4))
PATHS = {"straight": straight(8.0, 2.0), "bend": circle(3.0, 2.0)}


def alike(track: Track, law: str) -> tuple[PurePursuit | Stanley, GeometricLaw]:
    if law == "stanley":
        return Stanley(track, 0.02, 2.5, 1.7, 0.4), StanleyLaw(2.5, gain=1.7, softening=0.4)
    return PurePursuit(track, 0.02, 2.5, 0.4, 0.0), PurePursuitLaw(2.5, look_ahead=0.4)


@pytest.mark.parametrize("law", ["stanley", "pure_pursuit"])
@pytest.mark.parametrize("path", PATHS)
def test_a_law_is_the_controller_of_the_same_name(path: str, law: str) -> None:
    problem, track = course(PATHS[path])
    controller, own = alike(track, law)
    fitted = own.fitted(LawContext(problem.vehicle, problem.path.steady_reference, problem.inputs, (1.0,) * 4))
    reference = track.at(jnp.asarray(1.0)).point

    def angle_of(x: jax.Array) -> jax.Array:
        state = state_at(track, 1.0, *x)
        return controller.steering(state, nearest(track, state, jnp.asarray(1.0)))

    angles = jax.jit(jax.vmap(angle_of))(jnp.asarray(DEVIATIONS))
    w, thrust = fitted.inputs(problem.vehicle, tuple(DEVIATIONS.T), reference)
    np.testing.assert_allclose(w, np.tan(angles), atol=1e-7)
    np.testing.assert_allclose(thrust, -2.5 * DEVIATIONS[:, 3], atol=1e-12)
