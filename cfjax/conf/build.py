"""From a configuration to the objects of `cfjax.problem` and `cfjax.synthesis`, by their plain constructors."""

import dataclasses
import os
import pathlib
from collections.abc import Sequence
from importlib import resources
from typing import Any

from hydra import compose, initialize_config_module
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from cfjax.conf.command_line import hydra_overrides
from cfjax.conf.messages import one_line, shown
from cfjax.conf.own_vehicle import own_vehicle
from cfjax.conf.schema import (
    PATH_KINDS,
    VEHICLE_KINDS,
    Config,
    CustomConfig,
    PathConfig,
    VehicleConfig,
    WaypointsConfig,
)
from cfjax.errors import InputError
from cfjax.funnel import Objective
from cfjax.options import Elimination, Options, ProofLimits
from cfjax.problem import (
    Box,
    Disc,
    Ellipsoid,
    FootprintDisc,
    Interval,
    Method,
    Obstacle,
    Path,
    Polygon,
    Problem,
    Vehicle,
)


def typed(node: DictConfig) -> Config:
    """The configuration as a `Config`; nobody below sees a DictConfig.

    Raises:
        InputError: for keys that no schema knows (a leading + smuggles them past Hydra), missing and bad values.
    """
    try:
        unknown = sorted(_unknown_keys(node, ""))
        if unknown:
            raise InputError("; ".join(unknown))
        removed = {field.name for field in dataclasses.fields(Config)} - {str(key) for key in node}
        missing = sorted(OmegaConf.missing_keys(node) | removed)  # no default stands in: no sets would mean no S
        if missing:
            raise InputError(f"expected a value for {', '.join(missing)}, got none")
        config = OmegaConf.to_object(node)
    except OmegaConfBaseException as error:
        raise InputError(one_line(error)) from error
    assert isinstance(config, Config)
    for label, value, base, kinds in (
        ("path", config.path, PathConfig, PATH_KINDS),
        ("vehicle", config.vehicle, VehicleConfig, VEHICLE_KINDS),
    ):
        if not isinstance(value, base):
            raise InputError(f"{label}: expected a preset with one of the kinds {', '.join(kinds)}, got {value}")
        if kinds.get(value.kind) is not type(value):
            raise InputError(f"{label}.kind: expected the preset's own, got {value.kind}")
    return config


def preset_names() -> list[str]:
    """The paths that come with the package."""
    presets = resources.files("cfjax.conf") / "path"
    return sorted(entry.name.removesuffix(".yaml") for entry in presets.iterdir() if entry.name.endswith(".yaml"))


def preset(name: str, overrides: Sequence[str] = ()) -> Config:
    """The configuration of +path=NAME and further overrides, as on the command line.

    Raises:
        InputError: for a name that does not come with the package, and overrides that the command would refuse.
    """
    if name not in preset_names():
        raise InputError(f"path: expected one of {', '.join(preset_names())}, got {name}")
    given = hydra_overrides([f"+path={name}", *overrides], sweep=False)
    try:
        with initialize_config_module("cfjax.conf", version_base="1.3"):
            return typed(compose("train", given))
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(one_line(error)) from error


def yaml_of(config: Config) -> str:
    """The content of config.yaml; `config_of` reads it back."""
    return OmegaConf.to_yaml(OmegaConf.structured(config))


def config_of(text: str) -> Config:
    """The configuration that stands in a run folder's config.yaml.

    Raises:
        InputError: where the text is not such a configuration.
    """
    try:
        data = OmegaConf.create(text)
        if not isinstance(data, DictConfig):
            raise InputError("config.yaml: expected keys and values")
        for label, kinds in (("path", PATH_KINDS), ("vehicle", VEHICLE_KINDS)):
            kind = OmegaConf.select(data, f"{label}.kind")
            if kind not in kinds:
                raise InputError(f"config.yaml: expected {label}.kind to be one of {', '.join(kinds)}, got {kind}")
            data[label] = OmegaConf.merge(OmegaConf.structured(kinds[kind]), data[label])
        node = OmegaConf.merge(OmegaConf.structured(Config), data)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"config.yaml: {one_line(error)}") from error
    assert isinstance(node, DictConfig)
    return typed(node)


def command_vehicle(config: Config, started_in: pathlib.Path) -> Vehicle | None:
    """The vehicle of the user's own that a command line asks for; None where it is another one.

    Not for a configuration that was read from a run's folder.

    Raises:
        InputError: as `own_vehicle`.
    """
    own = config.vehicle
    return own_vehicle(own.target, own.parameters, started_in) if isinstance(own, CustomConfig) else None


def waypoint_file(config: Config) -> pathlib.Path | None:
    """The file whose points the path goes through, if it is such a path."""
    return pathlib.Path(os.path.expanduser(config.path.file)) if isinstance(config.path, WaypointsConfig) else None


def with_waypoint_file(config: Config, file: pathlib.Path) -> Config:
    """The same configuration with the points in another place."""
    return dataclasses.replace(config, path=dataclasses.replace(config.path, file=str(file)))


def problem_of(config: Config, vehicle: Vehicle | None = None) -> Problem:
    """The question that the configuration asks, of its vehicle unless one is given.

    Raises:
        InputError: where it cannot be asked, or its vehicle is a class that a configuration does not load.
    """
    methods = {method.value: method for method in Method}
    if config.method not in methods:
        raise InputError(f"method: expected one of {', '.join(methods)}, got {config.method}")
    if len(config.timing) != 2:
        raise InputError(f"timing: expected two numbers, lower and upper, got {config.timing}")
    built: Vehicle = config.vehicle.build() if vehicle is None else vehicle
    dimension = len(built.state_names)
    goal, safe = config.sets.goal, config.sets.safe
    return Problem(
        path=_path_of(config.path, built),
        inlet=Ellipsoid(_half_axes("sets.inlet", config.sets.inlet, dimension)),
        goal=None if goal is None else Ellipsoid(_half_axes("sets.goal", goal, dimension)),
        safe=None if safe is None else Box(_half_axes("sets.safe", safe, dimension)),
        obstacles=_obstacles(config.sets.obstacles),
        footprint=_footprint(config.vehicle.footprint),
        vehicle=built,
        method=methods[config.method],
        timing=Interval(*config.timing),
        authority=config.authority,
    )


def options_of(config: Config) -> Options:
    """How to look for a funnel."""
    built = {
        "objective": Objective(config.objective.kind, config.objective.margin),
        "polytope": Elimination(**vars(config.polytope)),
        "proof": ProofLimits(**vars(config.proof)),
    }
    plain = [field.name for field in dataclasses.fields(Options) if field.name not in built]
    return Options(**built, **{name: getattr(config, name) for name in plain})


def _path_of(config: PathConfig, vehicle: Vehicle) -> Path:
    """The path; where its numbers, each good by itself, make none together, the message names their keys."""
    try:
        return config.build(vehicle)
    except (InputError, ArithmeticError) as error:
        if str(error).startswith("path."):
            raise
        numbers = {key: value for key, value in vars(config).items() if key not in ("name", "kind")}
        given = ", ".join(f"path.{key}={value}" for key, value in numbers.items())
        raise InputError(f"path: {error}; got {given}") from error


def _half_axes(label: str, value: Any, dimension: int) -> tuple[float, ...]:
    given = value if isinstance(value, Sequence) and not isinstance(value, str) else [value] * dimension
    numbers = _numbers(given)
    if numbers is None:
        raise InputError(f"{label}: expected a number or a list of {dimension} numbers, got {shown(value)}")
    if not all(0 < number < float("inf") for number in numbers):
        raise InputError(f"{label}: expected positive finite numbers, got {shown(value)}")
    return tuple(numbers)


def _numbers(given: Any, count: int | None = None) -> list[float] | None:
    """The list as numbers, so many if a count is given; None where it is no such list."""
    if not isinstance(given, Sequence) or isinstance(given, str) or count not in (None, len(given)):
        return None
    good = all(isinstance(number, int | float) and not isinstance(number, bool) for number in given)
    return [float(number) for number in given] if good else None


def _pairs(given: Any) -> tuple[tuple[float, float], ...] | None:
    """The list as pairs of numbers; None where it is no such list."""
    rows = [_numbers(row, 2) for row in given] if isinstance(given, list) else [None]
    pairs = tuple((row[0], row[1]) for row in rows if row)
    return pairs if len(pairs) == len(rows) else None


def _obstacles(value: Any) -> tuple[Obstacle, ...]:
    if not isinstance(value, list):
        raise InputError(f"sets.obstacles: expected a list, empty for none, got {shown(value)}")
    return tuple(map(_obstacle, value))


def _obstacle(entry: Any) -> Obstacle:
    (kind, shape), *more = entry.items() if isinstance(entry, dict) and entry else [("", None)]
    if kind == "disc" and not more and (numbers := _numbers(shape, 3)):
        return Disc(*numbers)
    if kind == "polygon" and not more and (corners := _pairs(shape)) is not None:
        return Polygon(corners)
    raise InputError(
        f"sets.obstacles: expected entries {{disc: [x, y, radius]}} or {{polygon: [[x, y], ...]}}, got {shown(entry)}"
    )


def _footprint(value: Any) -> tuple[FootprintDisc, ...]:
    discs = _pairs(value)
    if discs is None:
        raise InputError(f"vehicle.footprint: expected a list of discs [radius, offset], got {shown(value)}")
    return tuple(FootprintDisc(radius, offset) for radius, offset in discs)


def _unknown_keys(node: Any, prefix: str) -> list[str]:
    """Keys that stand in a typed node and not in its dataclass, with what would be known there."""
    if not isinstance(node, DictConfig) or node._is_missing() or node._is_none():
        return []
    found = []
    known = OmegaConf.get_type(node)
    names = [field.name for field in dataclasses.fields(known)] if dataclasses.is_dataclass(known) else None
    for key in node:
        if names is not None and key not in names:
            found.append(f"{prefix}{key}: no such key; expected one of {', '.join(names)}")
        elif not OmegaConf.is_missing(node, key):
            found += _unknown_keys(node[key], f"{prefix}{key}.")
    return found
