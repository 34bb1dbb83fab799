"""How much is too much: disturbance, delay and a wrong wheelbase, on the oval; funnels beside what users know.

Path following and trajectory tracking under the min-norm law of certified funnels, pure pursuit, Stanley, and an MPC
tracker that may choose its timing. All of them drive the same cars: the same starts (half of them on the boundary of
I, the others inside), limits of steering and thrust, control period, sensor and disturbance, one lap at 1 m/s. Success:
arrived in G without leaving S. S is looked at when commands change; no car is stopped.

- disturbance: uniform in ±d rad/s, m/s, m/s and m/s² on the rates of (α_R, x_R, y_R, v_R), anew every 0.5 s;
- delay: of every measurement; nobody compensates for it;
- mismatch: the car's wheelbase over the one that controllers know: it turns the less. From 1.47 on the reference
  cannot be followed exactly where it bends most.

Baselines are tuned, funnels are not: each baseline gets the numbers of a grid with the most successes over the nominal
car and one condition of each kind (`TUNED_AT`), with other starts and other noise; among equals the one with the
smallest rms lateral error. A point that is done stands in points.csv and is not driven again.
"""

import csv
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from matplotlib import rc_context
from matplotlib.figure import Figure

from cfjax.baselines import PurePursuit, Stanley, mpc
from cfjax.control import law_named
from cfjax.demonstrator.demonstrator import Horizon
from cfjax.demonstrator.task import weights_of
from cfjax.plants import Plant, Scene, Sensor
from cfjax.plants.model import inputs_of, world_rate
from cfjax.plants.plant import number
from cfjax.problem import KinematicBicycle
from cfjax.report.files import write_whole
from cfjax.report.style import SERIES_COLOURS, STYLE
from cfjax.result import Result
from cfjax.simulation.controller import Controller, Follower
from cfjax.simulation.sampled import SampledLoop, drive_sampled
from cfjax.simulation.starts import random_starts
from cfjax.simulation.track import track_of
from experiments.figures.figure import PF_COLOUR, TT_COLOUR, Claim, Drawn, Row, Setting, certified


PATH, PERIOD, HOLD = "oval", 0.02, 0.5  # s
LIMIT = 1.5  # times the reference's lap: a car that takes longer is given up
TUNING_CARS, TUNING_SEED = 100, 1000
Z = 1.96  # of the 95 % band


class Car(Plant):
    """The kinematic car with a disturbance of its deviation's rates and another wheelbase: both numbers, no shapes."""

    vehicle: KinematicBicycle = eqx.field(static=True)
    bound: Float[Array, ""] = eqx.field(converter=number)  # of all four rates: rad/s, m/s, m/s, m/s²
    ratio: Float[Array, ""] = eqx.field(converter=number)  # of the wheelbase

    @property
    def longest_step(self) -> float:
        return math.inf

    def start(self, state: Float[Array, " n"]) -> Float[Array, " z"]:
        return state

    def draw(self, key: PRNGKeyArray, time: Float[Array, ""]) -> Float[Array, " d"]:
        stretch = jnp.floor(time / HOLD + 1e-6).astype(int)
        return self.bound * jax.random.uniform(jax.random.fold_in(key, stretch), (4,), minval=-1.0, maxval=1.0)

    def rate(
        self, z: Float[Array, " z"], command: Float[Array, " m"], draw: Float[Array, " d"], scene: Scene
    ) -> Float[Array, " z"]:
        w, thrust = inputs_of(self.vehicle, command)
        c, s = jnp.cos(scene.heading), jnp.sin(scene.heading)
        added = draw.at[1].set(c * draw[1] - s * draw[2]).at[2].set(s * draw[1] + c * draw[2])
        return world_rate(self.vehicle, z, (w / self.ratio, thrust)) + added

    def observe(self, z: Float[Array, " z"]) -> Float[Array, " n"]:
        return z


@dataclass(frozen=True)
class Condition:
    disturbance: float = 0.0
    delay: float = 0.0  # s
    ratio: float = 1.0


PANELS: dict[str, tuple[str, tuple[Condition, ...]]] = {
    "disturbance": (
        "disturbance $d$ (rad/s, m/s, m/s, m/s²)",
        tuple(Condition(disturbance=d) for d in (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)),
    ),
    "delay": ("delay (s)", tuple(Condition(delay=t) for t in (0.0, 0.04, 0.08, 0.12, 0.16, 0.2, 0.24, 0.28))),
    "ratio": ("wheelbase / assumed wheelbase", tuple(Condition(ratio=r) for r in (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0))),
}
TUNED_AT = (Condition(), Condition(disturbance=0.75), Condition(delay=0.16), Condition(ratio=2.0))

Make = Callable[..., Controller]
COLOURS = {
    "pf": PF_COLOUR,
    "tt": TT_COLOUR,
    "pure pursuit": SERIES_COLOURS[5],
    "Stanley": SERIES_COLOURS[1],
    "MPC": SERIES_COLOURS[2],
}
LABELS = {"pf": "funnel, path following", "tt": "funnel, trajectory tracking"}
MARKERS = {"pf": "o", "tt": "s", "pure pursuit": "^", "Stanley": "v", "MPC": "D"}


@dataclass(frozen=True)
class Contender:
    """A controller with the numbers among which it is tuned, and the run in whose funnels V is looked at."""

    result: Result
    make: Make
    grid: tuple[dict[str, float], ...] = ({},)


def contenders(setting: Setting) -> dict[str, Contender]:
    """All five; baselines look at the track of the path-following run, with one lap more ahead of them."""
    runs = {method: certified(setting, PATH, method) for method in ("pf", "tt")}
    free = runs["pf"]
    ahead = track_of(free.problem, free.legs, 2)
    funnels = {
        method: Contender(run, partial(Follower, track_of(run.problem, run.legs), PERIOD, law_named(setting.law)))
        for method, run in runs.items()
    }

    def planned(effort: float) -> Controller:
        weights = weights_of(free.problem, effort=effort)
        return mpc(free.problem, track_of(free.problem, free.legs), PERIOD, horizon=Horizon(10, 0.1), weights=weights)

    return funnels | {
        "pure pursuit": Contender(
            free,
            partial(PurePursuit, ahead, PERIOD),
            grid_of(look_ahead=(0.3, 0.45, 0.6, 0.8), speed_gain=(2.0, 4.0)),
        ),
        "Stanley": Contender(
            free, partial(Stanley, ahead, PERIOD), grid_of(gain=(1.0, 2.0, 4.0, 8.0), speed_gain=(2.0, 4.0))
        ),
        "MPC": Contender(free, planned, grid_of(effort=(0.03, 0.1, 0.3, 1.0))),
    }


def grid_of(**values: tuple[float, ...]) -> tuple[dict[str, float], ...]:
    """All combinations."""
    return tuple(dict(zip(values, chosen, strict=True)) for chosen in product(*values.values()))


def run(contender: Contender, controller: Controller, at: Condition, cars: int, seed: int) -> SampledLoop:
    """Cars of one point: the same starts, disturbances and limits whoever drives."""
    result = contender.result
    problem, legs = result.problem, result.legs
    assert isinstance(problem.vehicle, KinematicBicycle)
    track = track_of(problem, legs)
    nothing = np.zeros(4)
    return drive_sampled(
        problem,
        legs,
        controller,
        Car(problem.vehicle, at.disturbance, at.ratio),
        random_starts(problem, track, cars, seed),
        period=PERIOD,
        sensor=Sensor(nothing, nothing, delay=at.delay),
        theta=np.zeros(cars),
        seed=seed,
        stop=False,
        limit=LIMIT * float(track.duration),
        recorded=1,
    )


# --- tuning and points, each kept when it is done


class Ledger:
    """Rows of a CSV file by their keys; written whole after each."""

    def __init__(self, path: Path, keys: tuple[str, ...]) -> None:
        self.path, self.keys = path, keys
        self.rows: list[dict[str, str]] = []
        if path.exists():
            with path.open(encoding="utf-8", newline="") as file:
                self.rows = list(csv.DictReader(file))

    def find(self, **wanted: object) -> dict[str, str] | None:
        text = {key: str(value) for key, value in wanted.items()}
        return next((row for row in self.rows if all(row[key] == text[key] for key in self.keys)), None)

    def add(self, **row: object) -> dict[str, str]:
        added = {key: str(value) for key, value in row.items()}
        self.rows.append(added)
        lines = [",".join(added), *(",".join(own.values()) for own in self.rows)]
        write_whole(self.path, ("\n".join(lines) + "\n").encode())
        return added


def tuned(name: str, contender: Contender, folder: Path) -> dict[str, float]:
    """The numbers of the grid that do best at `TUNED_AT`."""
    if len(contender.grid) == 1:
        return contender.grid[0]
    ledger = Ledger(folder / "tuning.csv", ("name", "numbers"))

    def score(numbers: dict[str, float]) -> tuple[float, float]:
        key = {"name": name, "numbers": " ".join(f"{label}={value:g}" for label, value in numbers.items())}
        row = ledger.find(**key)
        if row is None:
            controller = contender.make(**numbers)
            loops = [run(contender, controller, at, TUNING_CARS, TUNING_SEED) for at in TUNED_AT]
            success, error = (
                float(np.mean([getattr(loop, field).mean() for loop in loops])) for field in ("success", "rms_lateral")
            )
            row = ledger.add(**key, success=success, rms_lateral=error)
            print(", ".join(row.values()), flush=True)
        return float(row["success"]), -float(row["rms_lateral"])

    return max(contender.grid, key=score)


POINT_KEYS = ("name", "numbers", "disturbance", "delay", "ratio", "cars", "seed")


def points(setting: Setting, folder: Path) -> Iterator[dict[str, str]]:
    """Every point, driven where the folder does not hold it."""
    ledger = Ledger(folder / "points.csv", POINT_KEYS)
    for name, contender in contenders(setting).items():
        numbers = tuned(name, contender, folder)
        controller = contender.make(**numbers)
        cars = setting.mpc_cars if name == "MPC" else setting.cars
        label = " ".join(f"{key}={value:g}" for key, value in numbers.items())
        for at in dict.fromkeys(at for _, conditions in PANELS.values() for at in conditions):
            key = {"name": name, "numbers": label, **vars(at), "cars": cars, "seed": setting.seed}
            row = ledger.find(**key)
            if row is None:
                loop = run(contender, controller, at, cars, setting.seed)
                row = ledger.add(
                    **key,
                    success=int(loop.success.sum()),
                    left_safe=int(loop.left_safe.sum()),
                    missed_goal=int((loop.arrived & ~loop.in_goal).sum()),
                    late=int((~loop.arrived).sum()),
                    left_funnel=int(loop.left_funnel.sum()),
                    rms_lateral=float(np.median(loop.rms_lateral)),
                )
                print(", ".join(row.values()), flush=True)
            yield row


# --- the picture


def band(success: int, cars: int) -> tuple[float, float]:
    """Wilson's interval of a binomial share, 95 %."""
    share, z = success / cars, Z**2 / cars
    middle = (share + z / 2) / (1 + z)
    half = math.sqrt(z * share * (1 - share) + z**2 / 4) / (1 + z)
    return max(0.0, middle - half), min(1.0, middle + half)


def make(setting: Setting) -> Drawn:
    folder = setting.output / "robustness"
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for point in points(setting, folder):
        low, high = band(int(point["success"]), int(point["cars"]))
        share = int(point["success"]) / int(point["cars"])
        numbers = {key: float(point[key]) for key in ("disturbance", "delay", "ratio")}
        counts = {key: int(point[key]) for key in ("cars", "left_safe", "missed_goal", "late", "left_funnel")}
        rate: Row = {"success": share, "low": low, "high": high, "rms lateral, m": float(point["rms_lateral"])}
        rows.append({"name": point["name"], "numbers": point["numbers"], **numbers, **rate, **counts})
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 3.3), layout="constrained")
        panels = figure.subplots(1, 3, sharey=True)
        for axes, (key, (label, conditions)) in zip(panels, PANELS.items(), strict=True):
            for name, colour in COLOURS.items():
                own = [row for row in rows if row["name"] == name and condition_of(row) in conditions]
                own.sort(key=lambda row: row[key])
                at = [row[key] for row in own]
                low, high = ([100 * row[end] for row in own] for end in ("low", "high"))
                axes.fill_between(at, low, high, color=colour, alpha=0.18, lw=0)
                style = {"color": colour, "marker": MARKERS[name], "ms": 3.5, "lw": 1.2}
                axes.plot(at, [100 * row["success"] for row in own], **style, label=LABELS.get(name, name))
            axes.set(xlabel=label, ylim=(-3, 103))
            axes.margins(x=0.02)
            axes.locator_params(axis="x", nbins=5)
        panels[0].set_ylabel("cars that succeed (%)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8)
    return Drawn(figure, rows, claims_of(rows))


def condition_of(row: Row) -> Condition:
    return Condition(row["disturbance"], row["delay"], row["ratio"])


def claims_of(rows: list[Row]) -> list[Claim]:
    """Whether path following is the more robust: for each kind, where its band lies above that of tracking."""
    claims = []
    for key, (_, conditions) in PANELS.items():
        pf, tt = (
            {row[key]: row for row in rows if row["name"] == m and condition_of(row) in conditions}
            for m in ("pf", "tt")
        )
        better = [at for at in pf if pf[at]["low"] > tt[at]["high"]]
        worse = [at for at in pf if pf[at]["high"] < tt[at]["low"]]
        told = (
            f"{key}: path following succeeds more often at {_listed(better)}, less often at {_listed(worse)}, "
            "else the bands overlap"
        )
        agrees = None if not better and not worse else not worse
        claims.append(Claim("path following is more robust than trajectory tracking", told, agrees))
    return claims


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:g}" for value in sorted(values)) or "none"
