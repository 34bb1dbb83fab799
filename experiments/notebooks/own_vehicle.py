# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Your own vehicle
#
# The car of the package is one class of thirty lines; yours is another. We write a robot with two driven wheels, see
# that it moves as we think it does, let a funnel be found and proven for it, and then ask for more: that it is not the
# axle that follows the circle but a sensor in front of it.

# %%
# %matplotlib inline
import os
from dataclasses import dataclass, replace
from typing import ClassVar

import jax.numpy as jnp
import matplotlib
import numpy as np
from IPython.display import display
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import cfjax
from cfjax.check import check_document
from cfjax.problem import Interval, Twist, Vehicle
from cfjax.report.style import CAR_COLOUR, REFERENCE_COLOUR, STYLE
from cfjax.rounded import margin_text


matplotlib.rcParams.update(STYLE)

# %% [markdown]
# The one switch. With `CI` in the environment fewer cars are driven, and the search is a short one.

# %%
quick = bool(os.environ.get("CI"))
options = cfjax.Options(cars=300, restarts=1, rounds=1) if quick else cfjax.Options()

# %% [markdown]
# ## A robot in thirty lines
#
# A vehicle is its *body twist*, how fast it turns and moves in its own frame, and the rates of the states that are not
# its pose. At heading α forward is (−sin α, cos α), to the right of it is (cos α, sin α), and turning is
# counter-clockwise. `reference` says what the vehicle does that moves exactly along the path.


# %%
@dataclass(frozen=True)
class Robot(Vehicle):
    """Two driven wheels: it turns as it is told to, its speed is a state."""

    max_turn: float = 3.0  # rad/s
    max_thrust: float = 2.0  # m/s²

    name: ClassVar[str] = "robot"
    internal_names: ClassVar[tuple[str, ...]] = ("v",)
    internal_units: ClassVar[tuple[str, ...]] = ("m/s",)
    input_names: ClassVar[tuple[str, ...]] = ("turn", "thrust")

    @property
    def input_box(self):
        return Interval(-self.max_turn, self.max_turn), Interval(-self.max_thrust, self.max_thrust)

    def twist(self, internal, inputs):
        (v,), (turn, _) = internal, inputs
        return Twist(turn=turn, lateral=0.0, forward=v)

    def internal_rate(self, internal, inputs):
        _, thrust = inputs
        return (thrust,)

    def reference(self, turn_rate, speed):
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (speed,)


circle = cfjax.circle(radius=1.5, speed=1.0)
problem = cfjax.Problem(circle, vehicle=Robot(), safe=cfjax.Box((1.0, 1.0, 1.0, 2.0)))

# %% [markdown]
# ## Does it go where we think?
#
# The mistake that one makes first is a sign. So the inputs that hold the robot on the circle are held for a lap, in the
# inertial frame: where does it go?

# %%
held = problem.feedforward(circle.curve[0].point(0.0))[1:]
print(dict(zip(problem.vehicle.input_names, held.round(4).tolist(), strict=True)))


def world(vehicle, time, state, inputs):
    """d/dt of (α, x, y, v)."""
    twist = vehicle.twist(state[3:], inputs)
    c, s = np.cos(state[0]), np.sin(state[0])
    x, y = c * twist.lateral - s * twist.forward, s * twist.lateral + c * twist.forward
    return [twist.turn, x, y, *vehicle.internal_rate(state[3:], inputs)]


duration = circle.curve[0].duration
theta = np.linspace(0, duration, 60)
reference = circle.curve[0].poses(theta)
way = solve_ivp(
    lambda time, state: world(problem.vehicle, time, state, held),
    (0, duration),
    [*reference[0], 1.0],
    t_eval=theta,
    rtol=1e-9,
    atol=1e-9,
).y.T
print(f"farthest from the reference: {np.abs(way[:, :3] - reference).max():.2g}")
assert np.abs(way[:, :3] - reference).max() < 1e-6

figure = Figure(figsize=(3.4, 3.2), layout="constrained")
axes = figure.subplots()
axes.plot(*reference[:, 1:].T, color=REFERENCE_COLOUR, label="reference")
axes.plot(*way[::4, 1:3].T, "o", color=CAR_COLOUR, ms=3, label="robot")
axes.quiver(*way[::4, 1:3].T, -np.sin(way[::4, 0]), np.cos(way[::4, 0]), width=0.005, color=CAR_COLOUR)
axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
axes.legend(loc="center")
display(figure)

# %% [markdown]
# ## A funnel, and its proof
#
# Nothing else has to be written: JAX differentiates the class for the search, and its operations, one by one, become
# the graph that stands in the certificate.

# %%
result = cfjax.synthesize(problem, options)
print(f"{result.verdict.value}: λ = {margin_text(result.margin_certified)} 1/s")
display(result.plot())
assert result.verdict is cfjax.Verdict.CERTIFIED and result.closed_loop.left_funnel == 0

# %% [markdown]
# The checker replays the proof in exact arithmetic. It does not know your class, and says so: what it vouches for are
# the dynamics that stand in the file.

# %%
print(check_document(result.document).text)

# %% [markdown]
# ## What the proof cannot take
#
# Exact arithmetic knows +, −, ×, /, whole powers, square roots, sin, cos and tan. Anything else is refused by its name,
# before anything is computed.


# %%
class Dragged(Robot):
    def internal_rate(self, internal, inputs):
        _, thrust = inputs
        return (thrust - 0.1 * jnp.exp(internal[0]),)


try:
    cfjax.synthesize(replace(problem, vehicle=Dragged()), options)
except cfjax.InputError as error:
    print(f"InputError: {error}")
else:
    raise AssertionError("an operation without exact arithmetic was accepted")

# %% [markdown]
# ## Another point of the same robot
#
# A line sensor sits a quarter of a metre in front of the axle, and *it* is what has to follow the circle. Position now
# means the sensor's: it moves sideways when the robot turns. On the circle the body no longer looks along the path, and
# the axle goes round on a smaller circle, more slowly. `reference` says both.


# %%
@dataclass(frozen=True)
class Sensor(Robot):
    """The robot by a point in front of its axle."""

    ahead: float = 0.25  # m

    name: ClassVar[str] = "sensor"

    def twist(self, internal, inputs):
        (v,), (turn, _) = internal, inputs
        return Twist(turn=turn, lateral=-self.ahead * turn, forward=v)

    def reference(self, turn_rate, speed):
        across = self.ahead * turn_rate
        forward = jnp.sqrt(speed**2 - across**2)
        return Twist(turn=turn_rate, lateral=-across, forward=forward), (forward,)


sensed = replace(problem, vehicle=Sensor())
print(f"its body looks {np.degrees(sensed.side_slip):.2f}° away from the circle's tangent")
found = cfjax.synthesize(sensed, replace(options, cars=0))
by_sensor, by_axle = margin_text(found.margin_certified), margin_text(result.margin_certified)
print(f"{found.verdict.value}: λ = {by_sensor} 1/s, by its axle {by_axle} 1/s")
display(found.plot())
assert found.verdict is cfjax.Verdict.CERTIFIED

# %% [markdown]
# On an ellipse the angle would change along the way, and depend on all of the path before: that is refused.

# %%
try:
    replace(sensed, path=cfjax.ellipse())
except cfjax.InputError as error:
    print(f"InputError: {error}")
else:
    raise AssertionError("a path that the sensor's reference cannot be on was accepted")

# %% [markdown]
# From the command line a class in a file of yours is `vehicle=custom vehicle.target=my_module.Robot`;
# `docs/vehicles.md` has that, and how such a run is read again.
