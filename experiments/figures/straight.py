"""Fig. 6: a straight path from three groups of initial states, path following against trajectory tracking.

The paper plots x from its initial value to 12 m more and names no initial states. Chosen here, as deviations from the
start of the 8 m path (heading in rad, m, m/s), two for each group: (a) beside the path, near I; (b) farther from G, one
car behind the reference and one that is slower; (c) closer to G, one ahead of it and one that is faster. Past the
path's end the last ellipsoid of the funnel is held on to and the line goes on. Times are those at which a car has gone
4 and 12 m from where it was put, and those at which it passes the places 4 and 12 m after the path's start.
"""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cfjax.funnel import Funnel
from cfjax.problem import Path, Pose, Profile, Segment
from cfjax.report.style import STYLE
from cfjax.result import Result
from cfjax.simulation.starts import in_world
from cfjax.simulation.track import track_of
from experiments.figures.figure import NAMES, PF_COLOUR, TT_COLOUR, Claim, Drawn, Row, Setting, certified, drive, driven


GROUPS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "a": ((0.0, 0.6, 0.0, 0.0), (0.3, -0.5, 0.0, 0.0)),
    "b": ((0.0, 0.6, -1.2, 0.0), (0.3, -0.5, 0.0, -1.2)),
    "c": ((0.0, 0.6, 1.2, 0.0), (0.3, -0.5, 0.0, 1.2)),
}
TITLES = {"a": "near I", "b": "farther from G: behind; slow", "c": "closer to G: ahead; fast"}
START, LONG = -4.0, 11.0  # m, where the path begins; s that are driven
NEAR = 0.05  # m: from where on a car counts as on the path
SETTLED = 0.1  # m/s: from where on it counts as at the reference's speed


def make(setting: Setting) -> Drawn:
    rows: list[Row] = []
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 4.6), layout="constrained")
        axes = figure.subplots(2, 3, sharex=True, sharey="row")
        for method in ("pf", "tt"):
            result = prolonged(certified(setting, "straight_long", method))
            deviations = np.array([start for group in GROUPS.values() for start in group])
            starts = in_world(track_of(result.problem, result.legs), jnp.asarray(deviations))
            loop = drive(setting, result, starts)
            for car, start in enumerate(starts):
                own, group = driven(loop, car), tuple(GROUPS)[car // 2]
                state, clock = loop.samples.state[own, car], loop.samples.clock[own, car]
                x, y, v = state[:, 1], state[:, 2], state[:, 3]
                style = {"color": (PF_COLOUR, TT_COLOUR)[car % 2], "ls": "-" if method == "pf" else (0, (4, 2))}
                axes[0, car // 2].plot(x - START, y, lw=1.1, **style)
                axes[1, car // 2].plot(x - START, v, lw=1.1, **style)
                rows.append(
                    {
                        "group": group,
                        "start": car % 2 + 1,
                        "method": method,
                        "V": float(loop.start_value[car]),
                        "4 m gone, s": passing(clock, x, start[1] + 4),
                        "12 m gone, s": passing(clock, x, start[1] + 12),
                        "at 4 m, s": passing(clock, x, START + 4),
                        "at 12 m, s": passing(clock, x, START + 12),
                        "on path after, m": settled(x - start[1], y, NEAR),
                        "at speed after, s": settled(clock, v - 2.0, SETTLED),
                        "lowest, m/s": float(v.min()),
                        "highest, m/s": float(v.max()),
                        "swing, m/s": float(np.ptp(v)),
                    }
                )
        for column, (group, title) in enumerate(TITLES.items()):
            axes[0, column].set_title(f"({group}) {title}")
            axes[0, column].axhline(0, color="0.6", lw=0.7, zorder=0)
            axes[1, column].axhline(2, color="0.6", lw=0.7, zorder=0)
            axes[1, column].set(xlabel="$x$ from the path's start (m)", xlim=(-1.6, 13.6))
            for panel in axes[:, column]:
                panel.axvline(8, color="0.8", lw=0.7, ls=(0, (1, 2)), zorder=0)
        axes[0, 0].set_ylabel("$y$ (m)")
        axes[1, 0].set_ylabel("speed (m/s)")
        handles = [
            Line2D([], [], color="0.2", label=NAMES["pf"]),
            Line2D([], [], color="0.2", ls=(0, (4, 2)), label=NAMES["tt"]),
            Line2D([], [], color=PF_COLOUR, label="first start"),
            Line2D([], [], color=TT_COLOUR, label="second start"),
            Line2D([], [], color="0.7", ls=(0, (1, 2)), label="end of the certified path"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=5)
    return Drawn(figure, rows, claims_of(rows))


def prolonged(result: Result) -> Result:
    """The straight run on a line that goes on: its last ellipsoid, V = xᵀ(C/ρ(T))x, which is continuous there."""
    (found,), (segment,) = result.segments, result.problem.path.curve
    funnel, end = found.funnel, found.funnel.duration
    held = Funnel(funnel.template, funnel.shape / funnel.end_level, 0.0, LONG - end, funnel.beta_lower)
    line = Segment(
        Profile.constant(0.0, LONG), Profile.constant(segment.point(0.0).speed, LONG), Pose(-np.pi / 2, START, 0.0)
    )
    return result.replace(
        problem=replace(result.problem, path=Path("straight", (line,))),
        segments=(replace(found, span=(0.0, end)), replace(found, funnel=held, span=(end, LONG))),
    )


def passing(clock: Float[np.ndarray, " t"], x: Float[np.ndarray, " t"], place: float) -> float:
    """When the car passes a place (m), s; not a number where it does not."""
    beyond = np.flatnonzero(x >= place)
    if not len(beyond) or not beyond[0]:
        return float("nan") if not len(beyond) else 0.0
    k = beyond[0]
    return float(np.interp(place, x[k - 1 : k + 1], clock[k - 1 : k + 1]))


def settled(way: Float[np.ndarray, " t"], error: Float[np.ndarray, " t"], small: float) -> float:
    """The way, or clock, after which |error| stays small."""
    off = np.flatnonzero(np.abs(error) > small)
    return float(way[off[-1]]) if len(off) else 0.0


def claims_of(rows: list[Row]) -> list[Claim]:
    """The paper's text beside the numbers."""

    def both(group: str, key: str) -> list[tuple[float, float]]:
        own = {(row["start"], row["method"]): row[key] for row in rows if row["group"] == group}
        return [(own[start, "pf"], own[start, "tt"]) for start in (1, 2)]

    def told(pairs: list[tuple[float, float]], unit: str) -> str:
        return "; ".join(f"PF {pf:.2f}, TT {tt:.2f} {unit}" for pf, tt in pairs)

    near, swing = both("a", "12 m gone, s"), both("a", "swing, m/s")
    behind, ahead_ = both("b", "at 4 m, s"), both("c", "at 12 m, s")
    behind_own, ahead_own = both("b", "4 m gone, s"), both("c", "12 m gone, s")
    way = [pair for group in GROUPS for pair in both(group, "on path after, m")]
    change, until = (
        [pair for group in "bc" for pair in both(group, key)] for key in ("swing, m/s", "at speed after, s")
    )
    return [
        Claim(
            "(a) the simulation time for all cases is similar, around 6 s",
            f"12 m gone after {told(near, 's')}",
            all(abs(value - 6) < 0.3 for pair in near for value in pair),
        ),
        Claim(
            "(a) the speed is almost constant for both methods",
            f"largest less least speed: {told(swing, 'm/s')}",
            all(value < 0.4 for pair in swing for value in pair),
        ),
        Claim(
            "(b) path following takes longer to reach x = 4",
            f"{told(behind, 's')}; 4 m from where it was put: {told(behind_own, 's')}",
            all(pf > tt for pf, tt in behind) and all(pf > tt for pf, tt in behind_own),
        ),
        Claim(
            "(c) path following takes a shorter time to reach x = 12",
            f"{told(ahead_, 's')}; 12 m from where it was put: {told(ahead_own, 's')}",
            all(pf < tt for pf, tt in ahead_) and all(pf < tt for pf, tt in ahead_own),
        ),
        Claim(
            "path following converges faster to the path",
            f"|y| < {NEAR:g} m for good after {told(way, 'm')}",
            all(pf < tt for pf, tt in way),
        ),
        Claim(
            "(b, c) path following changes the speed smoothly",
            f"largest less least speed: {told(change, 'm/s')}",
            all(pf < tt for pf, tt in change),
        ),
        Claim(
            "(b, c) trajectory tracking settles the target speed immediately",
            f"within {SETTLED:g} m/s of it after {told(until, 's')}",
            all(tt < pf for pf, tt in until),
        ),
    ]
