"""An experiment: a run's funnels with a plant, a sensor, a law and starts, set up from the words of a command line."""

from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from cfjax.coerce import one_of
from cfjax.control import LAWS, law_named
from cfjax.errors import InputError
from cfjax.funnel.sampled import Holds, holds
from cfjax.plants import HostPlant, Plant, Sensor, plant_named, sensor_named
from cfjax.problem import Frame, Problem
from cfjax.result import Result
from cfjax.simulation.controller import Controller, Follower, HoldFollower
from cfjax.simulation.sampled import SampledLoop, drive_sampled
from cfjax.simulation.starts import random_starts, read_starts, worst_starts
from cfjax.simulation.track import Track, track_of


PERIOD, PERIODS = 5e-3, 500  # s; and how many the reference time of the path has at least
AHEAD = "sampled"  # the law that looks one hold ahead
CARS, OTHERS_CARS = 1000, 20  # unless somebody says; of plants that are stepped one by one


@dataclass(frozen=True)
class Setup:
    """The words of the command line (`cfjax.simulate`); None stands for the usual value.

    Raises:
        InputError: for a law or a frame that does not exist, or fewer than one car.
    """

    folder: Path
    plant: str = "model"
    noise: str = "none"
    law: str = "min_norm"
    n: int | None = None
    period: float | None = None  # s
    starts: str = "random"
    seed: int = 0
    laps: int = 1
    path: Path | None = None
    vehicle: str | None = None  # module.Class, of a run of one's own
    frame: str | None = None  # of headings in cars.csv; None: the run's

    def __post_init__(self) -> None:
        one_of("law", self.law, (*LAWS, AHEAD))
        if self.frame is not None:
            Frame(self.frame)
        if self.n is not None and self.n < 1:
            raise InputError(f"--n: expected at least one car, got {self.n}")


@dataclass(frozen=True)
class Experiment:
    """All that is driven."""

    setup: Setup
    result: Result  # of a tube's run: that of the path which is driven
    track: Track
    plant: Plant | HostPlant
    sensor: Sensor
    controller: Controller
    inherits: bool  # whether its law does what is proven
    period: float  # s
    starts: Float[np.ndarray, "k n"]
    frame: Frame  # of headings in cars.csv
    theta: Float[np.ndarray, " k"] | None  # where on the path they start, where that is not looked for

    @property
    def problem(self) -> Problem:
        return self.result.problem


def set_up(setup: Setup, result: Result, frame: Frame) -> Experiment:
    """Build everything that `setup` names around a certified result along a path; `frame` is that of the run.

    Raises:
        InputError: says what was expected.
    """
    frame = frame if setup.frame is None else Frame(setup.frame)
    problem = result.problem
    plant, sensor = plant_named(setup.plant, problem.vehicle), sensor_named(setup.noise, problem.vehicle)
    track = track_of(problem, result.legs, setup.laps)
    duration = float(track.duration)
    ahead = _ahead(result) if setup.law == AHEAD else None
    usual = min(PERIOD, duration / PERIODS) if ahead is None else float(ahead.period)
    period = usual if setup.period is None else setup.period
    if not 0 < period < duration:
        raise InputError(f"--period: expected seconds between 0 and the path's {duration:.4g}, got {period:g}")
    if ahead is None:
        law = law_named(setup.law)
        controller, inherits = Follower(track, jnp.asarray(period), law), law.inherits
    else:
        controller, inherits = HoldFollower(track, ahead, jnp.asarray(period), sensor.remembered(period)), True
    count = setup.n or (OTHERS_CARS if isinstance(plant, HostPlant) else CARS)
    theta = None
    if setup.starts == "random":
        starts = random_starts(problem, track, count, setup.seed)
    elif setup.starts == "worst":
        starts, theta = worst_starts(track, count, setup.seed), np.zeros(count)
    else:
        starts = read_starts(problem, Path(setup.starts))[: setup.n]
    return Experiment(setup, result, track, plant, sensor, controller, inherits, period, starts, frame, theta)


def _ahead(result: Result) -> Holds:
    """The numbers of the law that looks one hold ahead."""
    sampled = result.robustness and result.robustness.sampled
    if not sampled:
        raise InputError(f"--law {AHEAD}: expected a run with period=…, in which sampled control is proven")
    inputs, bends = np.array(sampled.inputs), np.array(sampled.bends)
    funnel = result.segments[0].funnel
    return holds(result.problem, funnel, sampled.period, sampled.order, sampled.decrease, inputs, bends)


def run_experiment(experiment: Experiment) -> SampledLoop:
    """Drive the cars; raises InputError as `drive_sampled` does."""
    return drive_sampled(
        experiment.problem,
        experiment.result.legs,
        experiment.controller,
        experiment.plant,
        experiment.starts,
        period=experiment.period,
        sensor=experiment.sensor,
        theta=experiment.theta,
        laps=experiment.setup.laps,
        seed=experiment.setup.seed,
    )
