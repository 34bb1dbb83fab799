"""Runs of a vehicle of the user's own: its class is named by whoever reads the folder, never by the folder."""

from pathlib import Path
from typing import Any

from cfjax.conf import Config, CustomConfig, own_vehicle
from cfjax.errors import InputError
from cfjax.problem import Problem, Vehicle
from cfjax.report.files import CERTIFICATE, read_json


def named_vehicle(folder: Path, config: Config, target: str | None) -> Vehicle | None:
    """The vehicle of the class `module.Class` for a run of such a vehicle; None for a run of one of the package's.

    Raises:
        InputError: where a class is needed and none is named, or the other way round.
    """
    own = config.vehicle
    if isinstance(own, CustomConfig):
        if target is None:
            raise InputError(
                f"{folder}: the run of a vehicle of somebody's own, {own.target}; name it: --vehicle module.Class"
            )
        return own_vehicle(target, own.parameters, Path.cwd())
    if target is not None:
        raise InputError(f"--vehicle: expected the run of a vehicle of your own, {folder} is one of {own.kind}")
    return None


def speaks_of(document: dict[str, Any], vehicle: Vehicle) -> bool:
    """Whether a certificate's vehicle, with its dynamics, is this one."""
    from cfjax.certificate.trace import trace_deviation  # here: a run does not wait for the proof's imports
    from cfjax.certificate.writing import write_vehicle

    return document.get("problem", {}).get("vehicle") == write_vehicle(vehicle, trace_deviation(vehicle))


def is_proven_of(folder: Path, config: Config, problem: Problem) -> bool:
    """Whether the certificate of a run of this configuration speaks of the problem's vehicle, as it is now.

    A vehicle of the package is named by its configuration; a class of the user's own may have changed since the run.
    """
    if not isinstance(config.vehicle, CustomConfig):
        return True
    return (folder / CERTIFICATE).exists() and speaks_of(read_json(folder / CERTIFICATE), problem.vehicle)
