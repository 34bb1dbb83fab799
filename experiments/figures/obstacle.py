"""Beside an obstacle: guaranteed drives, drives that are safe without guarantee, and unsafe ones.

The law takes over 1.5 m before the obstacle, at x = −1.5 m. Cars have deviations up to four times those of the
funnel's head, in random directions of (α, y, v); those whose body begins outside the region do not count. Guaranteed
are those whose whole state is in it, V ≤ 1; of the others, those are safe whose body stays where the body of a
guaranteed car may be, and unsafe those that leave this region, into the obstacle or not.
"""

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Bool, Float
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cfjax.report.draw import draw, handles
from cfjax.report.plane import Plane
from cfjax.report.style import CAR_COLOUR, FAILED_COLOUR, STYLE
from cfjax.simulation.sampled import SampledLoop
from cfjax.simulation.starts import in_world
from cfjax.simulation.track import track_of
from experiments.figures.figure import Claim, Drawn, Setting, certified, drive, driven


REACH = 4.0  # of the deviations, times the funnel's head
ROUNDING = 2e-3  # m: the region is drawn with polygons
SHOWN = 6  # cars of each kind
TITLES = ("guaranteed", "not guaranteed, but safe", "not guaranteed, unsafe")
GOES_ON = 0.5  # m around the path's end: there the region ends, and a body beyond it is not held against a car


def make(setting: Setting) -> Drawn:
    result = certified(setting, "obstacle", "pf")
    track = track_of(result.problem, result.legs)
    direction = jax.random.normal(jax.random.key(setting.seed), (setting.cars, 4)).at[:, 2].set(0.0)  # at x = -1.5 m
    shape = result.segments[0].funnel.shape
    size = jnp.sqrt(jnp.einsum("ki,ij,kj->k", direction, jnp.asarray(shape), direction))
    scale = jnp.concatenate(
        [jnp.full(setting.cars // 4, 1 - 1e-9), jnp.linspace(1.0, REACH, setting.cars - setting.cars // 4)]
    )
    starts = in_world(track, direction * (scale / size)[:, None])
    loop = drive(setting, result, starts, recorded=setting.cars)
    plane = Plane(result.replace(worst_points=()))
    panel = plane.panel([])
    guaranteed = loop.start_value <= 1
    hit = loop.clearance < 0
    inside, begins = stays(plane, loop, result.problem.footprint[0].radius)
    inside &= ~hit
    kinds = (guaranteed, ~guaranteed & begins & inside, ~guaranteed & begins & ~inside)
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.55), layout="constrained")
        for axes, title, kind in zip(figure.subplots(1, 3, sharey=True), TITLES, kinds, strict=True):
            draw(axes, panel)
            some = np.flatnonzero(kind)
            if kind is kinds[2]:  # some of either
                some = np.concatenate(
                    [np.flatnonzero(kind & hit)[: SHOWN // 2], np.flatnonzero(kind & ~hit)[: SHOWN // 2]]
                )
            for car in some[:SHOWN]:
                position = loop.samples.state[driven(loop, car), car, 1:3]
                colour = FAILED_COLOUR if hit[car] else CAR_COLOUR
                axes.plot(*position.T, color=colour, lw=0.9, zorder=5)
                axes.plot(*position[0], ".", color=colour, ms=4, zorder=5)
            axes.set_title(f"({'abc'[TITLES.index(title)]}) {title}")
            axes.set(xlim=(-2.6, 2.2), ylim=(-0.75, 1.6))
            axes.label_outer()
        entries = [
            *handles(panel),
            Line2D([], [], color=CAR_COLOUR, lw=0.9, label="cars"),
            Line2D([], [], color=FAILED_COLOUR, lw=0.9, label="cars that hit"),
        ]
        figure.legend(handles=entries, loc="outside lower center", ncols=5, fontsize=8, handlelength=1.6)
    rows = [
        {
            "starts": title,
            "cars": int(kind.sum()),
            "in G": int((kind & loop.in_goal).sum()),
            "left the reach": int((kind & ~inside).sum()),
            "hit the obstacle": int((kind & hit).sum()),
            "V at the start": f"{loop.start_value[kind].min():.2f} to {loop.start_value[kind].max():.2f}"
            if kind.any()
            else "–",
            "largest V": float(loop.largest_value[kind].max()) if kind.any() else float("nan"),
            "least clearance, m": float(loop.clearance[kind].min()) if kind.any() else float("nan"),
        }
        for title, kind in zip(TITLES, kinds, strict=True)
    ]
    in_plane = ~guaranteed & begins & np.array([shapely.contains_xy(plane.funnel, *start[1:3]) for start in starts])
    lost, over = int((in_plane & ~inside).sum()), int(in_plane.sum())
    head = f"{lost} of {over} cars that start over the funnel's shadow with V > 1 leave the region"
    first, second, third = rows
    return Drawn(
        figure,
        rows,
        [
            Claim(
                "(a) cars that start inside the head remain inside the funnel and reach the tail",
                f"largest V {first['largest V']:.4f}, {first['in G']} of {first['cars']} in G, "
                f"least clearance {first['least clearance, m']:.3f} m",
                first["largest V"] <= 1 + 1e-6 and first["in G"] == first["cars"],
            ),
            Claim(
                "(b) the whole body may remain in the region although a car starts outside the head",
                f"{second['cars']} cars, from V = {second['V at the start']}",
                second["cars"] > 0,
            ),
            Claim(
                "(c) without guarantee cars may leave the region",
                f"{third['cars']} cars, {third['hit the obstacle']} of them into the obstacle",
                third["cars"] > 0,
            ),
            Claim("not only x and y have to be inside the funnel, but v and α too", head, lost > 0),
        ],
    )


def stays(plane: Plane, loop: SampledLoop, radius: float) -> tuple[Bool[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
    """Whether each car's disc (m) stays where that of a car in the funnel may be, and whether it begins there."""
    # a disc is inside the region where its centre is inside the region shrunk by it
    room = shapely.buffer(plane.body, ROUNDING - radius)
    last = shapely.Point(plane.line[-1]).buffer(GOES_ON)  # a car arrives there, its body reaches beyond
    room = shapely.union(room, last)
    shapely.prepare(room)

    def one(car: int) -> Bool[np.ndarray, " t"]:
        position: Float[np.ndarray, "t 2"] = loop.samples.state[driven(loop, car), car, 1:3]
        return shapely.contains_xy(room, position[:, 0], position[:, 1])

    every = [one(car) for car in range(len(loop.arrived))]
    return np.array([inside.all() for inside in every]), np.array([bool(inside[0]) for inside in every])
