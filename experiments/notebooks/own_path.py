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
# # Your own path
#
# To a car's deviation a path is only its turning rate and its speed: poses follow by integration. So that is how a
# path is written: two profiles over θ. We write a lane change by hand, and a track through points, and ask whether a
# car can be held on them.

# %%
# %matplotlib inline
import os
import tempfile
from pathlib import Path

import matplotlib
import numpy as np
from IPython.display import display
from matplotlib.figure import Figure

import cfjax
from cfjax.problem import Pose, Profile, Segment
from cfjax.report.style import EDGE_COLOUR, REFERENCE_COLOUR, STYLE
from cfjax.rounded import margin_text


matplotlib.rcParams.update(STYLE)

# %% [markdown]
# The one switch. With `CI` in the environment fewer cars are driven, and the funnel that is made for the lane change
# alone, some minutes' work, is left out.

# %%
quick = bool(os.environ.get("CI"))
cars = 300 if quick else 10_000

# %% [markdown]
# ## A lane change, by its profiles
#
# Turn to the left and back: a turning rate like w(θ) ~ θ(1 − θ)(1 − 2θ), which is 0 at both ends, so that straight
# road can follow. `Profile` is a piecewise polynomial: breaks in s, coefficients ascending. The speed is 2 m/s
# throughout.

# %%
duration, most = 3.0, 1.6  # s, and the largest turning rate in rad/s
shape = np.polynomial.Polynomial.fromroots([0, 0.5, 1])
peak = np.abs(shape(np.linspace(0, 1, 1001))).max()
coefficients = most / peak * shape.coef / duration ** np.arange(4)
turn_rate = Profile((0.0, duration), (tuple(coefficients),))
lane_change = cfjax.Path(
    "lane_change", (Segment(turn_rate, Profile.constant(2.0, duration), Pose(alpha=0.0, x=0.0, y=0.0)),)
)

theta = np.linspace(0, duration, 200)
poses = lane_change.curve[0].poses(theta)
figure = Figure(figsize=(7.6, 2.4), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(theta, turn_rate.polynomial(theta))
left.set(xlabel="θ (s)", ylabel="turning rate (rad/s)")
right.plot(poses[:, 2], -poses[:, 1])
right.set(xlabel="ahead (m)", ylabel="to the left (m)", aspect="equal")
display(figure)
print(f"curvature up to {most / 2:.2g} 1/m, and the lane is {-poses[-1, 1]:.2f} m to the left")

# %% [markdown]
# ## Is there a tube that holds it?
#
# Twelve tubes travel with the package, each proven once for *every* path within its bounds. `follow` looks for a
# chain of them and proves that the path keeps their bounds. That takes milliseconds.

# %%
found = cfjax.follow(lane_change)
print(found)

# %% [markdown]
# What does not fit is told in one line: which bound is broken, where, and by how much.

# %%
try:
    cfjax.follow(cfjax.circle(radius=0.3, speed=2.0))
except cfjax.InputError as error:
    print(f"InputError: {error}")
else:
    raise AssertionError("a bend that no car can take was accepted")

# %% [markdown]
# ## A problem on it, and cars
#
# The same path between sets I and G. `certificate="tube"` takes a tube that is there already.

# %%
problem = cfjax.Problem(lane_change, inlet=cfjax.ball(0.2), goal=cfjax.ball(0.5))
result = cfjax.synthesize(problem, cfjax.Options(certificate="tube", cars=cars))
print(result.verdict.value, f"{margin_text(result.margin_certified)} 1/s")
display(result.plot())
assert result.verdict is cfjax.Verdict.CERTIFIED and result.closed_loop.left_funnel == 0

# %% [markdown]
# A funnel that is made for this path alone is proven along stretches of θ. It costs minutes instead of nothing, and
# its margin is its own.

# %%
if not quick:
    own = cfjax.synthesize(problem, cfjax.Options(certificate="segment", cars=cars))
    print(own.verdict.value, f"{margin_text(own.margin_certified)} 1/s")
    display(own.plot())

# %% [markdown]
# ## Through points
#
# A file of points (columns x, y and, if wanted, speed) becomes a smooth path whose speed keeps steering, thrust and
# lateral acceleration inside their limits.

# %%
angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
points = np.stack(
    [(3 + 0.4 * np.cos(3 * angle)) * np.cos(angle), (2 + 0.3 * np.sin(2 * angle)) * np.sin(angle)], axis=-1
)
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "points.csv"
    np.savetxt(file, points, delimiter=",", header="x,y", comments="")
    track = cfjax.waypoints(file, closed=True)
chain = cfjax.follow(track, closed=True)
print(chain)

figure = Figure(figsize=(5, 3.2), layout="constrained")
axes = figure.subplots()
for segment in track.curve:
    places = segment.poses(np.linspace(0, segment.duration, 50))
    axes.plot(places[:, 1], places[:, 2], color=EDGE_COLOUR)
axes.plot(*points.T, "o", color=REFERENCE_COLOUR, ms=3)
axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
display(figure)

# %% [markdown]
# `docs/paths.md` has the rest: obstacles, chains of funnels, and the command line's `+path=waypoints
# path.file=points.csv`.
