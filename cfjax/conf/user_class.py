"""vehicle=custom: a class of the user's own, in a module that Python finds from where the command was started.

Code is loaded by its name on a command line or in the user's own configuration alone. What a run's folder says of it
(`config.yaml`) is a name that is never imported: whoever reads the folder names the class again.
"""

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cfjax
from cfjax.errors import InputError


def own_vehicle(target: str, parameters: Mapping[str, Any], started_in: Path) -> "cfjax.Vehicle":
    """The vehicle of the class `module.Class`, constructed with the parameters.

    Raises:
        InputError: where there is no such class, or it is none of a vehicle.
    """
    place, _, name = target.rpartition(".")
    if not place or not name:
        raise InputError(f"vehicle.target: expected module.Class, got {target}")
    if str(started_in) not in sys.path:  # an installed command does not look there by itself
        sys.path.insert(0, str(started_in))
    try:
        module = importlib.import_module(place)
    except Exception as error:  # whatever a module of the user's does
        if isinstance(error, ModuleNotFoundError) and f"{place}.".startswith(f"{error.name}."):
            raise InputError(
                f"vehicle.target: expected a module that Python finds from {started_in}, got {place}"
            ) from error
        raise InputError(f"vehicle.target: cannot import {place} ({type(error).__name__}: {error})") from error
    found = getattr(module, name, None)
    if not (isinstance(found, type) and issubclass(found, cfjax.Vehicle)):
        raise InputError(f"vehicle.target: expected a class {name} in {place} that is a cfjax.problem.Vehicle")
    try:
        vehicle = found(**parameters)
        hash(vehicle)
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"vehicle.target: expected a frozen dataclass {name} whose fields are the parameters, cannot make one with "
            f"{dict(parameters)} ({type(error).__name__}: {error})"
        ) from error
    return vehicle
