"""From a configuration to the objects of `cfjax.problem` and `cfjax.synthesis`, by their plain constructors."""

import contextlib
import dataclasses
import os
import pathlib
from collections.abc import Iterator, Sequence
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

import cfjax
from cfjax.coerce import Refused
from cfjax.conf.command_line import RENAMED, hydra_overrides
from cfjax.conf.messages import one_line, shown
from cfjax.conf.schema import (
    PATH_KINDS,
    VEHICLE_KINDS,
    Config,
    CustomConfig,
    PathConfig,
    PlanConfig,
    VehicleConfig,
    WaypointsConfig,
)
from cfjax.conf.user_class import own_vehicle
from cfjax.errors import InputError, meant, renamed
from cfjax.learner.elimination import Elimination
from cfjax.options import Options, ProofLimits


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


def preset_folder() -> pathlib.Path:
    """Where the YAML of the presets lies: `conf/` beside the package; a wheel carries it inside, as `conf/presets/`."""
    room = pathlib.Path(__file__).resolve().parent
    carried = room / "presets"  # looked for first: what lies beside an installed package belongs to others
    return carried if carried.is_dir() else room.parents[1] / "conf"


def preset_names() -> list[str]:
    """The paths that come with the package."""
    return sorted(file.stem for file in (preset_folder() / "path").glob("*.yaml"))


def preset(name: str, overrides: Sequence[str] = ()) -> Config:
    """The configuration of +path=NAME and further overrides, as on the command line.

    Raises:
        InputError: for a name that does not come with the package, and overrides that the command would refuse.
    """
    if name not in preset_names():
        raise InputError(f"path: expected one of {', '.join(preset_names())}, got {name}{meant(name, preset_names())}")
    given = hydra_overrides([f"+path={name}", *overrides], sweep=False)
    try:
        with initialize_config_dir(str(preset_folder()), version_base="1.3"):
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
        for old, new in RENAMED.items():
            if old in data:
                renamed(f"config.yaml: {old}", new)
                data[new] = data.pop(old)
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


def command_vehicle(config: Config, started_in: pathlib.Path) -> "cfjax.Vehicle | None":
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


def with_own_map(config: Config, folder: pathlib.Path) -> Config:
    """The same configuration with the map and edges in it whose files, relative to a folder, it names: its own copy."""
    from cfjax.problem.corridor import with_own_points  # here: --help does not wait for it

    corridor = with_own_points(config.sets.corridor, folder)
    config = dataclasses.replace(config, sets=dataclasses.replace(config.sets, corridor=corridor))
    if not isinstance(config.path, PlanConfig):
        return config
    return dataclasses.replace(config, path=config.path.read(folder))


def problem_of(config: Config, vehicle: "cfjax.Vehicle | None" = None) -> "cfjax.Problem":
    """The question that the configuration asks, of its vehicle unless one is given.

    Raises:
        InputError: where it cannot be asked, or its vehicle is a class that a configuration does not load.
    """
    with _as_typed():
        built: cfjax.Vehicle = config.vehicle.build() if vehicle is None else vehicle
        problem = cfjax.Problem(
            path=_path_of(config.path, built),
            **vars(config.sets),
            footprint=config.vehicle.footprint,
            vehicle=built,
            method=config.method,
            timing=config.timing,
            input_share=config.input_share,
            law=config.law.build(),
        )
        return config.path.posed(problem)


def options_of(config: Config) -> Options:
    """How to look for a funnel."""
    with _as_typed():
        built = {
            "objective": cfjax.Objective(config.objective.kind, config.objective.margin),
            "polytope": Elimination(**vars(config.polytope)),
            "proof": ProofLimits(**vars(config.proof)),
        }
        plain = [field.name for field in dataclasses.fields(Options) if field.name not in built]
        return Options(**built, **{name: getattr(config, name) for name in plain})


@contextlib.contextmanager
def _as_typed() -> Iterator[None]:
    """What is refused is shown as it stands on a command line or in YAML: null, true, text without quotes."""
    try:
        yield
    except Refused as error:
        raise InputError(f"{error.name}: expected {error.expected}, got {shown(error.value)}") from error


def _path_of(config: PathConfig, vehicle: "cfjax.Vehicle") -> "cfjax.Path":
    """The path; where its numbers, each good by itself, make none together, the message names their keys."""
    try:
        return config.build(vehicle)
    except (InputError, ArithmeticError) as error:
        if str(error).startswith("path."):
            raise
        numbers = {key: value for key, value in vars(config).items() if key not in ("name", "kind")}
        given = ", ".join(f"path.{key}={value}" for key, value in numbers.items())
        raise InputError(f"path: {error}; got {given}") from error


def _unknown_keys(node: Any, prefix: str) -> list[str]:
    """Keys that stand in a typed node and not in its dataclass, with what would be known there."""
    if not isinstance(node, DictConfig) or node._is_missing() or node._is_none():
        return []
    found = []
    known = OmegaConf.get_type(node)
    names = [field.name for field in dataclasses.fields(known)] if dataclasses.is_dataclass(known) else None
    for key in node:
        if names is not None and key not in names:
            found.append(f"{prefix}{key}: no such key; expected one of {', '.join(names)}{meant(str(key), names)}")
        elif not OmegaConf.is_missing(node, key):
            found += _unknown_keys(node[key], f"{prefix}{key}.")
    return found
