"""What can be configured: one dataclass per group. Keys, types and defaults stand here and nowhere else.

The comment beside a key says what it means, after its unit and a comma where it has one. A key whose default is that of
another class, like `Options.seed`, is described there. `scripts/keys.py` makes docs/keys.md of this.

Values are checked where the objects that they describe are constructed (`cfjax.problem`, `cfjax.synthesis`); here
only what has no object of its own.
"""

import abc
import copy
import math
import os
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from omegaconf import MISSING

import cfjax
from cfjax.coerce import one_of
from cfjax.errors import InputError
from cfjax.funnel import Objective
from cfjax.learner import DEFAULT
from cfjax.learner.elimination import Elimination
from cfjax.options import Options, ProofLimits


INTERVAL = "a number or an interval [lower, upper]"
GAIN = "a list of rows of numbers, a number, or null"
BY_STATE = "a number or a list of numbers, one a state"
DISCS = "a list of discs [radius, offset]"
CORRIDOR = 'a half-width, {left: …, right: …}, "file" or null'
OBSTACLES = "a list, like [{disc: [x, y, radius]}]"


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

    def posed(self, problem: "cfjax.Problem") -> "cfjax.Problem":
        """The problem along the path that was built; of a path that depends on its sets, along that one."""
        return problem


@dataclass
class StraightConfig(PathConfig):
    """A straight line."""

    kind: str = "straight"
    length: float = 4.0  # m, of the line
    speed: float = 2.0  # m/s, along the path

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.straight(self.length, self.speed).segments)


@dataclass
class CircleConfig(PathConfig):
    """A circle, counter-clockwise."""

    kind: str = "circle"
    radius: float = 1.5  # m, of the circle
    speed: float = math.pi / 2  # m/s, along the path
    laps: float = 1.0  # how often round

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.circle(self.radius, self.speed, self.laps).segments)


@dataclass
class OvalConfig(PathConfig):
    """The paper's oval, x²/4 + y² = 1 m²."""

    kind: str = "oval"
    speed: float = 1.0  # m/s, along the path

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.oval(self.speed).segments)


@dataclass
class EllipseConfig(PathConfig):
    """x²/a² + y²/b² = 1, counter-clockwise from (a, 0)."""

    kind: str = "ellipse"
    a: float = 2.0  # m, half axis along x
    b: float = 1.0  # m, half axis along y
    speed: float = 1.0  # m/s, along the path
    segments: int = 2  # of equal length, in each lap
    laps: int = 1  # how often round

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.ellipse(self.a, self.b, self.speed, self.segments, self.laps).segments)


@dataclass
class FigureEightConfig(PathConfig):
    """A lemniscate, one lap from its crossing."""

    kind: str = "figure_eight"
    size: float = 2.0  # m, from the crossing to the farthest point
    speed: float = 1.0  # m/s, along the path

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.figure_eight(self.size, self.speed).segments)


@dataclass
class SlalomConfig(PathConfig):
    """y = amplitude · sin(2π periods x/length)."""

    kind: str = "slalom"
    length: float = 12.0  # m, along x
    amplitude: float = 0.5  # m, of the wave
    periods: int = 3  # of the wave
    speed: float = 1.0  # m/s, along the path

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.slalom(self.length, self.amplitude, self.periods, self.speed).segments)


@dataclass
class ObstacleConfig(PathConfig):
    """The paper's path around an obstacle."""

    kind: str = "obstacle"
    speed: float = 2.0  # m/s, along the path

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.obstacle_path(self.speed).segments)


@dataclass
class WaypointsConfig(PathConfig):
    """Through the points of a CSV file."""

    kind: str = "waypoints"
    file: str = MISSING  # the file's name, relative to where the command was started
    columns: list[str] | None = None  # names of all columns, with units, as [x_mm,y_mm,v_kmh]; null: the file's header
    closed: bool | None = None  # whether it is a lap; null: where its end meets its beginning
    speed: float | None = None  # m/s, at most; null: what the file says, or 2
    least_speed: float | None = None  # m/s, driven where the file says less; null: a stop is refused
    lateral_acceleration: float = 4.0  # m/s², at most, in bends
    acceleration: float | None = 1.0  # m/s², at most, along the path; null: what thrust allows
    reserve: float = 0.2  # part of steering and of thrust that is left to feedback
    segment_length: float | None = None  # m, about; null: by the wheelbase, 10 m for a car of 0.34 m
    smoothing: float = 0.0  # m, root mean square by which the curve may pass the points; 0: through them

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
    """Every path within bounds: numbers or intervals. A number for curvature or acceleration stands for ± itself."""

    kind: str = "tube"
    speed: Any = _any_of(INTERVAL, 1.0)  # m/s, along the path
    curvature: Any = _any_of(INTERVAL, 1.0)  # 1/m, to the left where positive
    acceleration: Any = _any_of(INTERVAL, 0.0)  # m/s², dv/dθ of the reference

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        return cfjax.Path(self.name, cfjax.tube(self.curvature, self.speed, self.acceleration).segments)


@dataclass
class PlanConfig(PathConfig):
    """From a start to a goal through a map, clear of its obstacles."""

    kind: str = "plan"
    map: Any = _any_of(
        "a file's name, or a map {obstacles: [...], bounds: [x, y, x, y]}", MISSING
    )  # what is in the way
    unknown_is_free: bool = False  # whether cells of an occupancy grid of which nothing is known may be driven on
    start: Any = _any_of("a pose [x, y, heading]", MISSING)  # m and rad, 0 along +y
    goal: Any = _any_of("a pose [x, y, heading]", MISSING)  # m and rad, as `start`
    speed: float = 2.0  # m/s, at most
    lateral_acceleration: float = 4.0  # m/s², at most, in bends

    def build(self, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
        """A straight line, until the sets are known between which a path is planned."""
        return cfjax.Path(self.name, cfjax.straight(speed=self.speed).segments)

    def read(self, folder: pathlib.Path) -> "PlanConfig":
        """The same with the map itself instead of its file's name, which is relative to a folder."""
        if not isinstance(self.map, str):
            return self
        name = folder / os.path.expanduser(self.map)
        return replace(self, map=cfjax.planner.read_map(name, unknown_is_free=self.unknown_is_free).entries)

    def posed(self, problem: "cfjax.Problem") -> "cfjax.Problem":
        if problem.obstacles:
            raise InputError("sets.obstacles: expected none beside path.map, which has the obstacles")
        map = self.read(pathlib.Path()).map
        if not isinstance(map, Mapping) or map.keys() - {"obstacles", "bounds"}:
            raise InputError(f"path.map: expected the name of a file, or obstacles and bounds, got {map}")
        from cfjax.planner.posed import planned  # here: a list of keys does not wait for it

        own = cfjax.Map(**map, source="path.map")
        return planned(problem, own, self.start, self.goal, self.speed, self.lateral_acceleration)


PATH_KINDS: dict[str, type[PathConfig]] = {
    "straight": StraightConfig,
    "circle": CircleConfig,
    "oval": OvalConfig,
    "ellipse": EllipseConfig,
    "figure_eight": FigureEightConfig,
    "slalom": SlalomConfig,
    "obstacle": ObstacleConfig,
    "waypoints": WaypointsConfig,
    "plan": PlanConfig,
    "tube": TubeConfig,
}


@dataclass
class VehicleConfig(abc.ABC):
    """A vehicle with numbers; `kind` says which of these classes it is."""

    kind: str = MISSING
    footprint: Any = _any_of(DISCS, [[0.25, 0.0]])  # m, what stands for the body; only obstacles ask for it

    @abc.abstractmethod
    def build(self) -> "cfjax.Vehicle": ...


@dataclass
class BicycleConfig(VehicleConfig):
    """The kinematic bicycle, with the rear axle as its reference point."""

    kind: str = "bicycle"
    wheelbase: float = 0.34  # m, from axle to axle
    max_tan_steering: float = 1.0  # the tangent of the largest steering angle: 0.466 for 25 degrees
    max_thrust: float = 4.0  # m/s², the largest acceleration, either way

    def build(self) -> "cfjax.Vehicle":
        return cfjax.KinematicBicycle(self.wheelbase, self.max_tan_steering, self.max_thrust)


@dataclass
class CustomConfig(VehicleConfig):
    """A vehicle of the user's own."""

    kind: str = "custom"
    target: str = MISSING  # its class, module.Class, in a module that Python finds from where you are
    parameters: dict[str, Any] = field(default_factory=dict)  # what the class is constructed with

    def build(self) -> "cfjax.Vehicle":
        # config.yaml of a folder that somebody sent must not load code
        raise InputError(f"vehicle: {self.target} is a class of somebody's own: expected its name on the command line")


VEHICLE_KINDS: dict[str, type[VehicleConfig]] = {"bicycle": BicycleConfig, "custom": CustomConfig}


@dataclass
class SetsConfig:
    """Deviations in the units of the states: of a car heading in rad, x and y in m, speed in m/s."""

    inlet: Any = _any_of(BY_STATE, 0.5)  # I, where the car may start: the radius of a ball, or half-axes
    goal: Any = _any_of(BY_STATE, 0.5)  # G, where it has to end, as I; null (of a tube only): none
    safe: Any = _any_of(f"{BY_STATE}, or null", None)  # S, where it has to stay: half-widths; null: no limit
    obstacles: Any = _any_of(OBSTACLES, [])  # m, what the body must not touch, or {polygon: [[x, y], …]}, {wall: …}
    corridor: Any = _any_of(CORRIDOR, None)  # m, walls left and right of the path; "file": by the widths in its file


@dataclass
class ObjectiveConfig:
    """The largest margin λ; or the narrowest funnel, or the largest I, that has a margin."""

    kind: str = Objective.kind
    margin: float | None = Objective.margin


@dataclass
class LawConfig:
    """The feedback law that gives the vehicle's inputs; with none, V is to fall under the best ones."""

    kind: str = "none"  # "none"; or "linear", u = u_r + K x, "stanley", "pure_pursuit"
    gain: Any = _any_of(GAIN, None)  # K of "linear", a row an input; of "stanley" k in 1/s; null: LQR, or 2 1/s
    speed_gain: float = 2.0  # 1/s, thrust for each m/s too fast, of "stanley" and "pure_pursuit"
    softening: float = 0.3  # m/s, added to the speed in "stanley"
    look_ahead: float = 0.45  # s, of the car's speed, in "pure_pursuit"

    def build(self) -> "cfjax.problem.FeedbackLaw | None":
        """The law."""
        laws, gain = cfjax.problem, 2.0 if self.gain is None else self.gain
        kinds = {
            "none": lambda: None,
            "linear": lambda: laws.LinearLaw(self.gain),
            "stanley": lambda: laws.StanleyLaw(self.speed_gain, gain=gain, softening=self.softening),
            "pure_pursuit": lambda: laws.PurePursuitLaw(self.speed_gain, look_ahead=self.look_ahead),
        }
        return kinds[one_of("law.kind", self.kind, kinds)]()


@dataclass
class PolytopeConfig:
    """Read only with learner=polytope."""

    margin: float = Elimination.margin
    climb: bool = Elimination.climb
    centre: str = Elimination.centre
    batch: int = Elimination.batch
    demonstrations: str = Elimination.demonstrations
    delta: float = Elimination.delta


@dataclass
class ProofConfig:
    """What a proof may take: it is estimated before anything is learned, and a larger one refused."""

    memory: float | None = ProofLimits.memory
    hours: float = ProofLimits.hours


@dataclass
class WandbConfig:
    """Read only with logger=wandb."""

    mode: str = "offline"  # "offline", "online" or "disabled"
    project: str = "cfjax"  # where the run is logged
    entity: str | None = None  # the account or team; null: the one that is logged in
    name: str | None = None  # of the run; null: one that W&B chooses
    group: str | None = None  # of runs; null: the sweep's folder
    tags: list[str] = field(default_factory=list)  # of the run

    def __post_init__(self) -> None:
        one_of("wandb.mode", self.mode, ("offline", "online", "disabled"))


@dataclass
class Config:
    """One run."""

    path: Any = MISSING  # a PathConfig, chosen by +path=NAME; the command fills in the default
    vehicle: Any = MISSING  # a VehicleConfig
    sets: SetsConfig = field(default_factory=SetsConfig)
    method: str = "pf"  # "pf", path following, with the timing u0 free; "tt", trajectory tracking, with u0 = 1
    timing: list[float] = field(default_factory=lambda: [0.5, 2.0])  # interval of u0 around 1; with pf only
    input_share: float = 1.0  # of the range from what the reference needs to the inputs' limits, that a law may use
    law: LawConfig = field(default_factory=LawConfig)
    template: str = Options.template
    certificate: str = Options.certificate
    learner: str = DEFAULT  # "gradient"; or "polytope", the paper's own, by elimination from demonstrations
    polytope: PolytopeConfig = field(default_factory=PolytopeConfig)
    proof: ProofConfig = field(default_factory=ProofConfig)
    objective: ObjectiveConfig = field(default_factory=ObjectiveConfig)
    beta_lower: float = Options.beta_lower
    beta_inner: float | None = Options.beta_inner
    restarts: int = Options.restarts
    rounds: int = Options.rounds
    solver: str = Options.solver
    seed: int = Options.seed
    robustness: bool = Options.robustness
    period: float | None = Options.period
    delay: float | None = Options.delay
    cars: int = Options.cars
    frame: str = "paper"  # of headings in files: "paper", alpha from +y; or "ros", yaw from +x (page frames.md)
    logger: str = "none"  # "none"; or "wandb", Weights & Biases
    wandb: WandbConfig = field(default_factory=WandbConfig)

    def __post_init__(self) -> None:
        one_of("frame", self.frame, ("paper", "ros"))
        one_of("logger", self.logger, ("none", "wandb"))
