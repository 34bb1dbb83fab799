"""Five rounds of the circle, as the paper's car drove them: path following and trajectory tracking, two laws.

The car is the single-track model with tyre slip and a steering servo, seen through motion capture with 20 ms of delay;
the numbers are of many cars that start in I, the picture shows one of them each time, from the same start.
"""

import jax
import numpy as np
from jaxtyping import Float
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cfjax.report.style import REFERENCE_COLOUR, STYLE
from cfjax.simulation.loop import sample_starts
from cfjax.simulation.sampled import SampledLoop
from cfjax.simulation.starts import in_world
from cfjax.simulation.track import track_of
from experiments.figures.figure import COLOURS, NAMES, Claim, Drawn, Row, Setting, certified, drive, driven


LAPS, CARS = 5, 50
LAWS = {"sontag": "Sontag's formula, clipped", "min_norm": "min-norm law"}
RADIUS, VIEW = 1.5, 2.1  # m
GOOD = 0.1  # m, rms: a third of the car's wheelbase
PLANT, NOISE = "single_track", "mocap,delay=0.02"


def make(setting: Setting) -> Drawn:
    rows: list[Row] = []
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 3.35), layout="constrained")
        planes = iter(figure.subplots(1, 4, sharex=True, sharey=True))
        for law, title in LAWS.items():
            for method in ("pf", "tt"):
                plane = next(planes)
                result = certified(setting, "circle", method)
                track = track_of(result.problem, result.legs)
                starts = in_world(track, sample_starts(jax.random.key(setting.seed), result.problem.inlet, CARS))
                loop = drive(setting, result, starts, plant=PLANT, noise=NOISE, laps=LAPS, law=law)
                plane.plot(*ring(RADIUS), color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)))
                own = driven(loop, 0)
                plane.plot(*loop.samples.state[own, 0, 1:3].T, color=COLOURS[method], lw=0.7)
                plane.plot(*starts[0, 1:3], "o", color=COLOURS[method], ms=4)
                plane.set_title(f"{title}\n{NAMES[method]}", fontsize=9)
                plane.set(xlabel="$x$ (m)", xlim=(-VIEW, VIEW), ylim=(-VIEW, VIEW))
                plane.set_box_aspect(1)
                if not rows:
                    plane.set_ylabel("$y$ (m)")
                rows.append(row_of(law, method, loop))
        handles = [
            Line2D([], [], color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)), label="reference"),
            Line2D([], [], color="0.3", marker="o", ms=4, lw=0.8, label="one car, from its start on"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return Drawn(figure, rows, claims_of(rows))


def row_of(law: str, method: str, loop: SampledLoop) -> Row:
    """The numbers of all cars, from the second round on: then the starts are forgotten."""
    lateral, theta = loop.samples.deviation[..., 1], loop.samples.theta
    own = [driven(loop, car) for car in range(CARS)]
    later = np.concatenate([lateral[o, car][theta[o, car] > theta.max() / LAPS] for car, o in enumerate(own)])
    return {
        "law": law,
        "method": method,
        "cars": CARS,
        "in G after five": int(loop.in_goal.sum()),
        "left S": int(loop.left_safe.sum()),
        "left the funnel": int(loop.left_funnel.sum()),
        "time, s": float(np.median(loop.time)),
        "rms lateral, m": float(np.sqrt((later**2).mean())),
        "largest, m": float(np.abs(later).max()),
        "steering at its limit, %": float(100 * loop.saturation[:, 0].mean()),
    }


def claims_of(rows: list[Row]) -> list[Claim]:
    """The paper's text beside the numbers of each law."""
    claims = []
    for law, title in LAWS.items():
        own = [row for row in rows if row["law"] == law]
        told = "; ".join(
            f"{row['method'].upper()}: {row['in G after five']} of {CARS} in G after five rounds, "
            f"rms {row['rms lateral, m']:.3f} m, {row['steering at its limit, %']:.3g} % at the limit"
            for row in own
        )
        good = all(row["in G after five"] == CARS and row["rms lateral, m"] < GOOD for row in own)
        paper = "despite noise and a simple model both controllers do a good job of following the reference path"
        claims.append(Claim(f"{paper} [{title}]", told, good))
    return claims


def ring(radius: float) -> Float[np.ndarray, "2 361"]:
    """A circle about the origin, m."""
    angle = np.linspace(0, 2 * np.pi, 361)
    return radius * np.stack([np.cos(angle), np.sin(angle)])
