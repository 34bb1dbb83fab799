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
# # Driving the exported controller
#
# A certified run becomes one C file without dependencies. Here it is exported, compiled and called from Python, round
# the oval, with a car that is integrated in NumPy: nothing of JAX drives. It needs a C compiler (`cc`, or the
# variable `CC`).

# %%
# %matplotlib inline
import os
import tempfile
import time
from pathlib import Path

import matplotlib
import numpy as np
from IPython.display import display
from matplotlib.figure import Figure

import cfjax
from cfjax.export import write_controller
from cfjax.export.compiled import OK, OUTSIDE, PAST_END, CompiledController, compile_controller
from cfjax.report.style import CAR_COLOUR, EDGE_COLOUR, REFERENCE_COLOUR, SERIES_COLOURS, STYLE
from cfjax.rounded import margin_text


matplotlib.rcParams.update(STYLE)

# %% [markdown]
# The one switch: with `CI` in the environment one lap, else five.

# %%
quick = bool(os.environ.get("CI"))
laps = 1 if quick else 5

# %% [markdown]
# ## A certified run
#
# The oval, held by a tube that came with the package: certified in seconds, lap after lap for ever.

# %%
problem = cfjax.Problem(cfjax.oval(speed=1.0), inlet=cfjax.ball(0.2), goal=cfjax.ball(0.5))
result = cfjax.search(problem, cfjax.Options(certificate="tube"))
assert result.verdict is cfjax.Verdict.CERTIFIED, result.message
print(f"{result.verdict.value}, {margin_text(result.margin_certified)} 1/s")

# %% [markdown]
# ## Export and compile
#
# On the command line: `python -m cfjax.export FOLDER`. The header says which certificate it comes from and what is
# guaranteed.

# %%
folder = Path(tempfile.mkdtemp())
header, source = write_controller(result, folder)
print("\n".join(header.read_text().splitlines()[:24]))
controller = CompiledController(compile_controller(folder), states=4, inputs=3, commands=2)

# %% [markdown]
# ## A car
#
# The bicycle with its rear axle at (x, y), told a steering angle and a thrust, which it holds for 5 ms: in plain
# NumPy, by RK4.


# %%
def rates(state: np.ndarray, steering: float, thrust: float) -> np.ndarray:
    """Of (heading, x, y, speed)."""
    alpha, _, _, v = state
    return np.array([v / 0.34 * np.tan(steering), -v * np.sin(alpha), v * np.cos(alpha), thrust])


def moved(state: np.ndarray, command: np.ndarray, step: float) -> np.ndarray:
    """After `step` seconds."""
    k1 = rates(state, *command)
    k2 = rates(state + 0.5 * step * k1, *command)
    k3 = rates(state + 0.5 * step * k2, *command)
    k4 = rates(state + step * k3, *command)
    return state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


# %% [markdown]
# ## Drive
#
# It starts 12 cm beside the oval, looking 5° off and a bit slow. `start` finds the place on the path where V is
# smallest; then a call each period.

# %%
period = 0.005
pose = result.problem.path.curve[0].start
state = np.array([pose.alpha + np.radians(5), pose.x + 0.12, pose.y, 0.95])
print("start:", controller.start(state), f"with V = {controller.memory.value:.3f}")
ways, values, commands, spent = [state], [], [], 0.0
while controller.memory.lap < laps:
    begin = time.perf_counter()
    status, command = controller.step(state, period)
    spent += time.perf_counter() - begin
    assert status == OK, status
    state = moved(state, command, period)
    ways.append(state)
    values.append(controller.memory.value)
    commands.append(command)
way, values, commands = np.array(ways), np.array(values), np.array(commands)
print(f"{laps} laps, {len(values)} calls; the largest V after the start was {values[1:].max():.3f}")
print(f"{1e6 * spent / len(values):.1f} µs a call, nearly all of it Python's way into C")
assert values.max() <= 1

# %%
figure = Figure(figsize=(8.4, 3.4), layout="constrained")
plane, right = figure.subplots(1, 2, width_ratios=[1.2, 1])
for segment in result.problem.path.curve:
    course = segment.poses(np.linspace(0, segment.duration, 100))
    plane.plot(course[:, 1], course[:, 2], color=REFERENCE_COLOUR, lw=0.8, ls="--")
plane.plot(way[:, 1], way[:, 2], color=CAR_COLOUR, lw=1.1)
plane.plot(*way[0, 1:3], "o", color=CAR_COLOUR)
plane.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
clock = period * np.arange(len(values))
right.plot(clock, np.degrees(commands[:, 0]), color=EDGE_COLOUR, label="steering (°)")
right.plot(clock, 100 * values, color=SERIES_COLOURS[0], label="V (%)")
right.set(xlabel="clock (s)", ylim=(0, 44))
right.legend(loc="upper center", ncols=2)
display(figure)

# %% [markdown]
# ## When things go wrong
#
# Not a number, or a car far away: a status, and a defined command. It never returns nothing.

# %%
meaning = {OK: "OK", PAST_END: "past the end", OUTSIDE: "outside the funnel"}
for name, measured in (("lost", np.full(4, np.nan)), ("far away", way[-1] + [0, 3, 0, 0])):
    status, command = controller.step(measured, period)
    print(
        f"{name}: {meaning.get(status, 'bad input')}; steering {np.degrees(command[0]):.1f}°, "
        f"thrust {command[1]:.2f} m/s²"
    )
    assert status != OK and np.isfinite(command).all()
