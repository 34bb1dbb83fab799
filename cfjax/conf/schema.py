"""What can be configured: one dataclass per group. Keys, types and defaults stand here and nowhere else.

Values are checked where the objects that they describe are constructed (`cfjax.problem`, `cfjax.synthesis`); here
only what has no object of its own.
"""

import abc
import copy
import math
from dataclasses import dataclass, field, replace
from typing import Any

from omegaconf import MISSING

import cfjax
from cfjax.coerce import one_of
from cfjax.errors import InputError
from cfjax.learner import DEFAULT
from cfjax.learner.elimination import Elimination
from cfjax.options import Options, ProofLimits


INTERVAL = "a number or an interval [lower, upper]"
BY_STATE = "a number or a list of numbers, one a state"


def _any_of(expected: str, default: Any) -> Any:
    """A field whose values no type describes: a mistaken one is answered by these words."""
    return field(default_factory=lambda: copy.copy(default), metadata={"expected": expected})


@dataclass
class PathConfig(abc.ABC):
    """A path with numbers; `name` is the preset's, `kind` says which of these classes it is."""

    name: str = MISSING
    kind: str = MISSING

    @abc.abstractmethod
    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        """The path, under the preset's name; the vehicle matters where the path's speed is made for it."""


@dataclass
class StraightConfig(PathConfig):
    kind: str = "straight"
    length: float = 4.0  # m
    speed: float = 2.0  # m/s

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.straight(self.length, self.speed).segments)


@dataclass
class CircleConfig(PathConfig):
    kind: str = "circle"
    radius: float = 1.5  # m
    speed: float = math.pi / 2  # m/s
    laps: float = 1.0

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.circle(self.radius, self.speed, self.laps).segments)


@dataclass
class OvalConfig(PathConfig):
    kind: str = "oval"
    speed: float = 1.0  # m/s

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.oval(self.speed).segments)


@dataclass
class EllipseConfig(PathConfig):
    kind: str = "ellipse"
    a: float = 2.0  # m, half axis along x
    b: float = 1.0  # m, half axis along y
    speed: float = 1.0  # m/s
    segments: int = 2  # of each lap
    laps: int = 1

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.ellipse(self.a, self.b, self.speed, self.segments, self.laps).segments)


@dataclass
class FigureEightConfig(PathConfig):
    kind: str = "figure_eight"
    size: float = 2.0  # m from the crossing to the farthest point
    speed: float = 1.0  # m/s

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.figure_eight(self.size, self.speed).segments)


@dataclass
class SlalomConfig(PathConfig):
    kind: str = "slalom"
    length: float = 12.0  # m
    amplitude: float = 0.5  # m
    periods: int = 3
    speed: float = 1.0  # m/s

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.slalom(self.length, self.amplitude, self.periods, self.speed).segments)


@dataclass
class ObstacleConfig(PathConfig):
    kind: str = "obstacle"
    speed: float = 2.0  # m/s

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.obstacle_path(self.speed).segments)


@dataclass
class WaypointsConfig(PathConfig):
    """The points of a CSV file; what the other keys mean: `cfjax.problem.waypoints`."""

    kind: str = "waypoints"
    file: str = MISSING  # relative to where the command was started
    columns: list[str] | None = None  # names of all columns, with units, as [x_mm,y_mm,v_kmh]; null: the file's header
    closed: bool | None = None  # null: where its end meets its beginning
    speed: float | None = None  # m/s at most; null: what the file says, or 2
    least_speed: float | None = None  # m/s, where the file says less; null: a stop is refused
    lateral_acceleration: float = 4.0  # m/s²
    acceleration: float | None = 1.0  # m/s²; null: what thrust allows
    reserve: float = 0.2  # part of steering and of thrust
    segment_length: float | None = None  # m; null: by the wheelbase, 10 m for a car of 0.34 m
    smoothing: float = 0.0  # m

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        try:
            path = cfjax.waypoints(
                self.file,
                columns=self.columns,
                closed=self.closed,
                speed=self.speed,
                least_speed=self.least_speed,
                lateral_acceleration=self.lateral_acceleration,
                acceleration=self.acceleration,
                reserve=self.reserve,
                vehicle=vehicle,
                segment_length=self.segment_length,
                smoothing=self.smoothing,
            )
        except InputError as error:
            raise InputError(str(error) if str(error).startswith("path.") else f"path.file: {error}") from error
        return replace(path, name=self.name)


@dataclass
class TubeConfig(PathConfig):
    """A number, or an interval [lower, upper]; of curvature and acceleration a number stands for ± itself."""

    kind: str = "tube"
    speed: Any = _any_of(INTERVAL, 1.0)  # m/s
    curvature: Any = _any_of(INTERVAL, 1.0)  # 1/m
    acceleration: Any = _any_of(INTERVAL, 0.0)  # dv/dtheta, m/s²

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.tube(self.curvature, self.speed, self.acceleration).segments)


PATH_KINDS: dict[str, type[PathConfig]] = {
    "straight": StraightConfig,
    "circle": CircleConfig,
    "oval": OvalConfig,
    "ellipse": EllipseConfig,
    "figure_eight": FigureEightConfig,
    "slalom": SlalomConfig,
    "obstacle": ObstacleConfig,
    "waypoints": WaypointsConfig,
    "tube": TubeConfig,
}


@dataclass
class VehicleConfig(abc.ABC):
    """A vehicle with numbers; `kind` says which of these classes it is. Its body: discs [radius, offset], m."""

    kind: str = MISSING
    footprint: Any = _any_of("a list of discs [radius, offset]", [[0.25, 0.0]])  # only obstacles ask for it

    @abc.abstractmethod
    def build(self) -> "cfjax.Vehicle": ...


@dataclass
class BicycleConfig(VehicleConfig):
    kind: str = "bicycle"
    wheelbase: float = 0.34  # m
    max_tan_steering: float = 1.0
    max_thrust: float = 4.0  # m/s²

    def build(self) -> "cfjax.Vehicle":
        return cfjax.KinematicBicycle(self.wheelbase, self.max_tan_steering, self.max_thrust)


@dataclass
class CustomConfig(VehicleConfig):
    """A vehicle of the user's own: the name of its class, module.Class, and what it is constructed with."""

    kind: str = "custom"
    target: str = MISSING
    parameters: dict[str, Any] = field(default_factory=dict)

    def build(self) -> "cfjax.Vehicle":
        # config.yaml of a folder that somebody sent must not load code
        raise InputError(f"vehicle: {self.target} is a class of somebody's own: expected its name on the command line")


VEHICLE_KINDS: dict[str, type[VehicleConfig]] = {"bicycle": BicycleConfig, "custom": CustomConfig}


@dataclass
class SetsConfig:
    """I and G: a number (radius of a ball) or one half-axis per state. S: one half-width per state, or null.

    Of a tube G may be null: then it is the tube itself that is kept.

    Obstacles, which belong to S too: {disc: [x, y, radius]} or {polygon: [[x, y], ...]}, convex; m.
    """

    inlet: Any = _any_of(BY_STATE, 0.5)
    goal: Any = _any_of(BY_STATE, 0.5)
    safe: Any = _any_of(f"{BY_STATE}, or null", None)
    obstacles: Any = _any_of("a list, like [{disc: [x, y, radius]}]", [])


@dataclass
class ObjectiveConfig:
    """`margin`: the largest λ; `width`, `inlet`: the narrowest funnel, or the largest I, that has the margin."""

    kind: str = "margin"  # or width, inlet
    margin: float | None = None  # 1/s


@dataclass
class PolytopeConfig:
    """Read only with learner=polytope."""

    margin: float = Elimination.margin  # 1/s
    climb: bool = Elimination.climb
    centre: str = Elimination.centre  # mve, analytic or chebyshev
    batch: int = Elimination.batch
    demonstrations: str = Elimination.demonstrations  # mpc or revised
    delta: float = Elimination.delta


@dataclass
class ProofConfig:
    """What a proof may take: it is estimated before anything is learned, and a larger one refused."""

    memory: float | None = ProofLimits.memory  # GB; null: what is free
    hours: float = ProofLimits.hours


@dataclass
class WandbConfig:
    """Read only with logger=wandb."""

    mode: str = "offline"  # or online, disabled
    project: str = "cfjax"
    entity: str | None = None
    name: str | None = None
    group: str | None = None
    tags: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        one_of("wandb.mode", self.mode, ("offline", "online", "disabled"))


@dataclass
class Config:
    """One run."""

    path: Any = MISSING  # a PathConfig, chosen by +path=NAME; the command fills in the default
    vehicle: Any = MISSING  # a VehicleConfig
    sets: SetsConfig = field(default_factory=SetsConfig)
    method: str = "pf"  # or tt
    timing: list[float] = field(default_factory=lambda: [0.5, 2.0])  # u0 of path following
    authority: float = 1.0  # how far a law may go from what the reference needs towards the limits of the inputs
    template: str = Options.template  # contracting or paper
    certificate: str = Options.certificate  # auto, segment or tube
    learner: str = DEFAULT  # gradient or polytope
    polytope: PolytopeConfig = field(default_factory=PolytopeConfig)
    proof: ProofConfig = field(default_factory=ProofConfig)
    objective: ObjectiveConfig = field(default_factory=ObjectiveConfig)
    beta_lower: float = Options.beta_lower
    beta_inner: float | None = Options.beta_inner
    restarts: int = Options.restarts
    rounds: int = Options.rounds
    solver: str = Options.solver  # of the sums of squares: batched, or clarabel (through CVXPY)
    seed: int = Options.seed
    robustness: bool = Options.robustness  # what the funnel absorbs: control period, disturbances, delay
    cars: int = Options.cars
    logger: str = "none"  # or wandb
    wandb: WandbConfig = field(default_factory=WandbConfig)

    def __post_init__(self) -> None:
        one_of("logger", self.logger, ("none", "wandb"))
