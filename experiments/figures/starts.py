"""The circle from the paper's two named initial states: [−π/2, 0, 0, 0] and [π, 2.25, −1.4, 0].

Neither lies in S for any θ (the first is in the middle of the circle, the second 1.15 m outside; both stand still), so
that nothing is proven of these drives: this is what happens. θ = 0 at the start for both methods, on the model.
"""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cfjax.control import locate
from cfjax.report.style import REFERENCE_COLOUR, STYLE
from experiments.figures.figure import COLOURS, NAMES, Claim, Drawn, Row, Setting, certified, drive, driven
from experiments.figures.rounds import ring
from experiments.figures.straight import settled


STARTS = {"a": (-np.pi / 2, 0.0, 0.0, 0.0), "b": (np.pi, 2.25, -1.4, 0.0)}
NAMED = {"a": "[−π/2, 0, 0, 0]", "b": "[π, 2.25, −1.4, 0]"}
RADIUS, LAPS = 1.5, 2  # m
NEAR = 0.1  # m across the circle: from where on a car counts as on it
MARKS = (1.0, 2.0, 3.0)  # s, shown on the way


def make(setting: Setting) -> Drawn:
    rows: list[Row] = []
    states = np.array(list(STARTS.values()))
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 4.5), layout="constrained")
        planes = figure.subplots(1, 2)
        for method in ("pf", "tt"):
            result = certified(setting, "circle", method)
            loop = drive(setting, result, states, laps=LAPS)
            best = locate(result.problem, result.legs, states).value
            for car, name in enumerate(STARTS):
                own = driven(loop, car)
                clock, position = loop.samples.clock[own, car], loop.samples.state[own, car, 1:3]
                plane, colour = planes[car], COLOURS[method]
                plane.plot(*position.T, color=colour, lw=1.2)
                for mark in MARKS:
                    plane.plot(*(np.interp(mark, clock, value) for value in position.T), "o", color=colour, ms=3.5)
                distance = np.linalg.norm(position, axis=1)
                way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))])
                until = settled(way, distance - RADIUS, NEAR)
                inside = float(way[-1] * (distance < RADIUS - NEAR).mean())
                joined = int(np.searchsorted(way, until))
                turned = np.unwrap(np.arctan2(position[:, 1], position[:, 0]))
                rows.append(
                    {
                        "start": NAMED[name],
                        "method": method,
                        "V at θ = 0": float(loop.start_value[car]),
                        "least V over θ": float(best[car]),
                        "on the circle after, s": float(clock[joined]),
                        "way until then, m": until,
                        "joins at, °": float(np.degrees(turned[joined]) % 360),
                        "least radius, m": float(distance[clock > MARKS[0]].min()) if len(clock) else float("nan"),
                        "top speed, m/s": float(loop.samples.state[own, car, 3].max()),
                        "inside the circle, m": inside,
                        "arrived": bool(loop.arrived[car] and loop.in_goal[car]),
                    }
                )
        for plane, name in zip(planes, STARTS, strict=True):
            plane.plot(*ring(RADIUS), color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)))
            alpha, x, y, _ = STARTS[name]
            plane.annotate(
                "",
                (x - 0.45 * np.sin(alpha), y + 0.45 * np.cos(alpha)),
                (x, y),
                arrowprops={"arrowstyle": "-|>", "color": "0.2", "lw": 1.0},
                zorder=5,
            )
            plane.plot(x, y, "s", color="0.2", ms=5, zorder=5)
            plane.set(title=f"({name}) from {NAMED[name]}", xlabel="$x$ (m)", ylabel="$y$ (m)")
            plane.set_aspect("equal", adjustable="datalim")
        handles = [
            *(Line2D([], [], color=COLOURS[method], label=NAMES[method]) for method in COLOURS),
            Line2D([], [], color=REFERENCE_COLOUR, lw=0.9, ls=(0, (4, 3)), label="reference"),
            Line2D([], [], color="0.2", marker="s", ls="", ms=5, label="start, heading"),
            Line2D([], [], color="0.4", marker="o", ls="", ms=3.5, label="after 1, 2 and 3 s"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=5)
    return Drawn(figure, rows, claims_of(rows))


def claims_of(rows: list[Row]) -> list[Claim]:
    """The paper's text beside the numbers."""
    own = {(row["start"], row["method"]): row for row in rows}
    pf, tt = (own[NAMED["b"], method] for method in ("pf", "tt"))
    return [
        Claim(
            "both methods reach the path from both states",
            ", ".join(
                f"{row['start']} {row['method'].upper()} after {row['on the circle after, s']:.1f} s" for row in rows
            ),
            all(row["arrived"] for row in rows),
        ),
        Claim(
            "(b) trajectory tracking may take shortcuts to satisfy time constraints",
            f"way inside the circle, more than {NEAR:g} m from it: PF {pf['inside the circle, m']:.2f} m, "
            f"TT {tt['inside the circle, m']:.2f} m; it joins at {pf['joins at, °']:.0f}° and {tt['joins at, °']:.0f}°",
            tt["inside the circle, m"] > pf["inside the circle, m"] + NEAR,
        ),
    ]
