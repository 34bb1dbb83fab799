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
# # Faster and faster
#
# The paper drives a circle at up to 10π m/s and finds funnels for path following at every speed, and for tracking
# none from π m/s on. What becomes of the margin as the speed grows?
#
# Path following needs no thrust to catch up: who is late lets the reference wait. Its margin should grow with the
# speed, for the whole motion only runs faster. Tracking has to make up its time, with the same 4 m/s² at every speed.

# %%
# %matplotlib inline
import os
from dataclasses import replace

import matplotlib
import numpy as np
from IPython.display import display
from matplotlib.figure import Figure

import cfjax
from cfjax.report.style import SERIES_COLOURS, STYLE
from cfjax.rounded import margin_text


matplotlib.rcParams.update(STYLE)

# %% [markdown]
# The one switch. With `CI` in the environment: two speeds, and a short search. Else five, as in the paper.

# %%
quick = bool(os.environ.get("CI"))
speeds = np.pi * np.array([0.5, 10] if quick else [0.5, 1, 2, 4, 10])  # m/s
options = cfjax.Options(cars=0, robustness=False)
if quick:
    options = replace(options, restarts=1, rounds=1)

# %% [markdown]
# One synthesis for each speed and method. On the command line this would be `scripts/train -m +path=circle
# path.speed=1.5708,3.1416,… method=pf,tt`, with a table at the end.

# %%
margins = {}
for method in (cfjax.Method.PF, cfjax.Method.TT):
    for speed in speeds:
        problem = cfjax.Problem(cfjax.circle(speed=float(speed)), safe=cfjax.Box((1, 1, 1, 3)), method=method)
        result = cfjax.synthesize(problem, options)
        assert result.verdict is cfjax.Verdict.CERTIFIED, result.message
        margins[method, speed] = result.margin_certified
        print(f"{method.value} at {speed / np.pi:4.3g}π m/s: {margin_text(result.margin_certified)} 1/s proven")

# %%
figure = Figure(figsize=(7.6, 2.9), layout="constrained")
left, right = figure.subplots(1, 2)
for method, colour in ((cfjax.Method.PF, SERIES_COLOURS[0]), (cfjax.Method.TT, SERIES_COLOURS[5])):
    proven = np.array([margins[method, speed] for speed in speeds])
    left.loglog(speeds, proven, "o-", color=colour, label=method.value.upper())
    right.semilogx(speeds, proven / speeds, "o-", color=colour)
left.set(xlabel="speed (m/s)", ylabel="proven margin λ (1/s)")
right.set(xlabel="speed (m/s)", ylabel="the same, per metre (1/m)", ylim=(0, None))
left.legend()
display(figure)

# %% [markdown]
# At every speed there is a funnel, for both, and path following is ahead at each of them. Per metre of the path the
# margin falls for both: I and G stay as they are, half a metre and half a metre a second.

# %%
assert all(margins[cfjax.Method.PF, speed] > margins[cfjax.Method.TT, speed] for speed in speeds)
