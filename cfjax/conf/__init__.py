"""Configuration: schemas (`schema.py`), and how presets become a problem (`build.py`).

The presets are the YAML files of `preset_folder()`. Importing the package registers the schemas with Hydra, so that
presets can name them.
"""

from hydra.core.config_store import ConfigStore

from cfjax.conf.build import (
    command_vehicle,
    config_of,
    options_of,
    preset,
    preset_folder,
    preset_names,
    problem_of,
    typed,
    waypoint_file,
    with_own_map,
    with_waypoint_file,
    yaml_of,
)
from cfjax.conf.command_line import hydra_overrides, values_of
from cfjax.conf.help import help_text
from cfjax.conf.messages import one_line
from cfjax.conf.schema import PATH_KINDS, VEHICLE_KINDS, Config, CustomConfig
from cfjax.conf.user_class import own_vehicle


__all__ = [
    "Config",
    "CustomConfig",
    "command_vehicle",
    "config_of",
    "help_text",
    "hydra_overrides",
    "one_line",
    "options_of",
    "own_vehicle",
    "preset",
    "preset_folder",
    "preset_names",
    "problem_of",
    "typed",
    "values_of",
    "waypoint_file",
    "with_own_map",
    "with_waypoint_file",
    "yaml_of",
]

_store = ConfigStore.instance()
# There is one store, which nobody changes while a configuration is composed: Hydra copies it, with every schema in it,
# each time it looks for a group's choices, 79 times for --help.
vars(_store)["__deepcopy__"] = lambda _: _store
_store.store("config", Config)
for _kind, _path in PATH_KINDS.items():
    _store.store(_kind, _path, group="path_kind")
for _kind, _vehicle in VEHICLE_KINDS.items():
    _store.store(_kind, _vehicle, group="vehicle_kind")
