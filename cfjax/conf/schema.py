"""What can be configured: one dataclass per group. Keys, types and defaults stand here and nowhere else.

Values are checked where the objects that they describe are constructed (`cfjax.problem`, `cfjax.synthesis`); here
only what has no object of its own.
"""

import abc
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from omegaconf import MISSING

from cfjax.errors import InputError
from cfjax.options import Options
from cfjax.problem import KinematicBicycle, Path, Vehicle, circle, straight


@dataclass
class PathConfig(abc.ABC):
    """A path with numbers; `name` is the preset's, `kind` says which of these classes it is."""

    name: str = MISSING
    kind: str = MISSING

    @abc.abstractmethod
    def build(self) -> Path:
        """The path, under the preset's name."""


@dataclass
class StraightConfig(PathConfig):
    kind: str = "straight"
    length: float = 4.0  # m
    speed: float = 2.0  # m/s

    def build(self) -> Path:
        return Path(self.name, straight(self.length, self.speed).segments)


@dataclass
class CircleConfig(PathConfig):
    kind: str = "circle"
    radius: float = 1.5  # m
    speed: float = np.pi / 2  # m/s
    laps: float = 1.0

    def build(self) -> Path:
        return Path(self.name, circle(self.radius, self.speed, self.laps).segments)


PATH_KINDS: dict[str, type[PathConfig]] = {"straight": StraightConfig, "circle": CircleConfig}


@dataclass
class VehicleConfig(abc.ABC):
    """A vehicle with numbers; `kind` says which of these classes it is."""

    kind: str = MISSING

    @abc.abstractmethod
    def build(self) -> Vehicle: ...


@dataclass
class BicycleConfig(VehicleConfig):
    kind: str = "bicycle"
    wheelbase: float = 0.34  # m
    max_tan_steering: float = 1.0
    max_thrust: float = 4.0  # m/s²

    def build(self) -> Vehicle:
        return KinematicBicycle(self.wheelbase, self.max_tan_steering, self.max_thrust)


VEHICLE_KINDS: dict[str, type[VehicleConfig]] = {"bicycle": BicycleConfig}


@dataclass
class SetsConfig:
    """I and G: a number (radius of a ball) or one half-axis per state. S: one half-width per state, or null."""

    inlet: Any = 0.5
    goal: Any = 0.5
    safe: Any = None


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
        if self.mode not in (modes := ("offline", "online", "disabled")):
            raise InputError(f"wandb.mode: expected one of {', '.join(modes)}, got {self.mode}")


@dataclass
class Config:
    """One run."""

    path: Any = MISSING  # a PathConfig, chosen by +path=NAME
    vehicle: Any = MISSING  # a VehicleConfig
    sets: SetsConfig = field(default_factory=SetsConfig)
    method: str = "pf"  # or tt
    timing: list[float] = field(default_factory=lambda: [0.5, 2.0])  # u0 of path following
    template: str = Options.template  # contracting or paper
    learner: str = Options.learner
    beta_lower: float = Options.beta_lower
    restarts: int = Options.restarts
    rounds: int = Options.rounds
    seed: int = Options.seed
    cars: int = Options.cars
    logger: str = "none"  # or wandb
    wandb: WandbConfig = field(default_factory=WandbConfig)

    def __post_init__(self) -> None:
        if self.logger not in ("none", "wandb"):
            raise InputError(f"logger: expected one of none, wandb, got {self.logger}")
