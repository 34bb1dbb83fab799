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
# # First steps: a funnel, its proof, and cars through it
#
# A car is to follow a circle. It starts a little beside it. Can it be brought back, within its steering and thrust,
# and be sure to arrive? We ask for a **control funnel** around the circle, get one, see it proven, and drive.

# %%
# %matplotlib inline
import os

import matplotlib
import numpy as np
from IPython.display import display
from matplotlib.figure import Figure

import cfjax
from cfjax.check import check_document
from cfjax.report.style import STYLE
from cfjax.rounded import margin_text, rounded_up


matplotlib.rcParams.update(STYLE)

# %% [markdown]
# The one switch of this notebook. With `CI` in the environment fewer cars are driven; the proof is the same.

# %%
quick = bool(os.environ.get("CI"))
cars = 500 if quick else 10_000

# %% [markdown]
# ## The question
#
# A circle of 1.5 m at π/2 m/s, one lap. States are deviations from the reference: heading (rad), x and y (m), speed
# (m/s). The car starts in the ball I of radius 0.5 and has to be in G, as large, at the end; on the way it stays in
# the box S.

# %%
problem = cfjax.Problem(
    cfjax.circle(radius=1.5, speed=np.pi / 2),
    inlet=cfjax.ball(0.5),
    goal=cfjax.ball(0.5),
    safe=cfjax.Box((1, 1, 1, 3)),
)
names = ("u0", *problem.vehicle.input_names)
for name, interval in zip(names, problem.inputs, strict=True):
    print(f"{name:7} in [{interval.lower:g}, {interval.upper:g}]")

# %% [markdown]
# `u0` is the timing: how fast the reference runs. That the controller may choose it makes this path following; with
# `method=cfjax.Method.TT` the clock decides, and it is trajectory tracking.
#
# ## The answer
#
# `synthesize` learns a function V, proves it, and drives cars. It takes some ten seconds.

# %%
result = cfjax.synthesize(problem, cfjax.Options(cars=cars))
print(result.verdict.value)
print(f"falsified: no point was found where V falls slower than {margin_text(result.margin_falsified)} 1/s")
print(
    f"certified: it is proven that it can fall at {margin_text(result.margin_certified)} 1/s, everywhere on the shell"
)

# %%
display(result.plot())

# %% [markdown]
# Blue is the funnel, the set V ≤ 1, seen from above, with its start in turquoise and its end in violet; I and G are
# dotted. On the right V of the cars: it has to fall while it is between 0.9 and 1, and so nobody gets out.
#
# ## What V is
#
# At θ the funnel is the ellipsoid xᵀCx ≤ e^(−kθ): one matrix and one rate.

# %%
(found,) = result.segments
print(np.array_str(found.funnel.shape, precision=3, suppress_small=True))
print(f"k = {found.funnel.rate:.4g} 1/s")
for theta in (0.0, found.funnel.duration):
    widths = zip(problem.vehicle.state_names, found.funnel.half_widths(theta), strict=True)
    print(f"theta = {theta:.3g} s: " + ", ".join(f"{state} within {rounded_up(width, 3)}" for state, width in widths))

# %% [markdown]
# ## The proof
#
# `result.document` is what a run writes to `certificate.json`. The checker needs nothing else: rational numbers, no
# solver, no rounding. It says in words what it has proven.

# %%
report = check_document(result.document)
print(report.text)
assert result.verdict is cfjax.Verdict.CERTIFIED and report.outcome.value == 0

# %% [markdown]
# ## The cars
#
# They all start in I, at random. Three things must not happen.

# %%
loop = result.closed_loop
print(f"{loop.cars} cars: {loop.left_funnel} left the funnel, {loop.left_safe} left S, {loop.missed_goal} missed G")
print(f"the largest V was {loop.largest_value:.4f}; arrival after {loop.arrival[0]:.2f} to {loop.arrival[1]:.2f} s")
assert loop.left_funnel == loop.left_safe == loop.missed_goal == 0

(driven,) = result.rollouts
figure = Figure(figsize=(7, 2.6), layout="constrained")
for axes, state, label in zip(figure.subplots(1, 2), (1, 3), ("x, to the right (m)", "speed (m/s)"), strict=True):
    axes.plot(driven.clock, driven.x[:, :, state], lw=0.7)
    axes.set(xlabel="clock (s)", ylabel=f"deviation of {label}")
display(figure)

# %% [markdown]
# From here: `own_path` asks about another path, `certificate` opens the proof, `controller` takes the law to a car.
