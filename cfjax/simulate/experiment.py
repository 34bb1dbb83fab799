"""An experiment: a run's funnels, a plant, a sensor, a law and starts, from the words of a command line."""

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
from cfjax.report.run_folder import read_frame, read_run
from cfjax.result import Result
from cfjax.simulate.tube_course import along_path
from cfjax.simulation.controller import Controller, Follower, HoldFollower
from cfjax.simulation.sampled import SampledLoop, drive_sampled
from cfjax.simulation.starts import random_starts, read_starts, worst_starts
from cfjax.simulation.track import Track, track_of
from cfjax.verdict import Verdict


PERIOD, PERIODS = 5e-3, 500  # s; and how many the reference time of the path has at least
AHEAD = "sampled"  # the law that looks one hold ahead
CARS, OTHERS_CARS = 1000, 20  # unless somebody says; of plants that are stepped one by one


@dataclass(frozen=True)
class Question:
    """As on the command line, `cfjax.simulate`; None: what is usual."""

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


@dataclass(frozen=True)
class Experiment:
    """All that is driven."""

    question: Question
    result: Result  # of a tube's run as that of the path which is driven
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


def ask(question: Question) -> Experiment:
    """Read the run and build everything.

    Raises:
        InputError: says what was expected.
    """
    one_of("law", question.law, (*LAWS, AHEAD))
    frame = None if question.frame is None else Frame(question.frame)
    if question.n is not None and question.n < 1:
        raise InputError(f"--n: expected at least one car, got {question.n}")
    result = read_run(question.folder, question.vehicle)
    frame = frame or read_frame(question.folder)
    if result.verdict is not Verdict.CERTIFIED:
        raise InputError(f"{question.folder}: expected a certified run, this one is {result.verdict.value}")
    if result.problem.path.tube or question.path:
        result = along_path(result, question.path)
    problem = result.problem
    plant, sensor = plant_named(question.plant, problem.vehicle), sensor_named(question.noise, problem.vehicle)
    track = track_of(problem, result.legs, question.laps)
    duration = float(track.duration)
    ahead = _ahead(result) if question.law == AHEAD else None
    usual = min(PERIOD, duration / PERIODS) if ahead is None else float(ahead.period)
    period = usual if question.period is None else question.period
    if not 0 < period < duration:
        raise InputError(f"--period: expected seconds between 0 and the path's {duration:.4g}, got {period:g}")
    if ahead is None:
        law = law_named(question.law)
        controller, inherits = Follower(track, jnp.asarray(period), law), law.inherits
    else:
        controller, inherits = HoldFollower(track, ahead, jnp.asarray(period), sensor.remembered(period)), True
    count = question.n or (OTHERS_CARS if isinstance(plant, HostPlant) else CARS)
    theta = None
    if question.starts == "random":
        starts = random_starts(problem, track, count, question.seed)
    elif question.starts == "worst":
        starts, theta = worst_starts(track, count, question.seed), np.zeros(count)
    else:
        starts = read_starts(problem, Path(question.starts))[: question.n]
    return Experiment(question, result, track, plant, sensor, controller, inherits, period, starts, frame, theta)


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
        laps=experiment.question.laps,
        seed=experiment.question.seed,
    )
