"""The tubes that travel with the package: certificates in `library/`, one file each."""

import lzma
from dataclasses import replace
from functools import lru_cache
from importlib import resources
from os import PathLike
from pathlib import Path

from cfcheck import Outcome, check_document
from cfcheck.reader import Unreadable, read_json
from cfjax.coerce import file, flag, instance
from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle, Vehicle
from cfjax.tubes.certified import CertifiedTube, Origin, tube_of
from cfjax.tubes.vehicles import for_vehicle


SUFFIXES = (".json.xz", ".json")


def read_tube(path: str | PathLike[str], *, check: bool = True) -> CertifiedTube:
    """The tube that a certificate proves; its name is that of the file (or, for certificate.json, of its folder).

    Without `check` the proof is not replayed: for files that were checked before.

    Raises:
        InputError: where the file proves no tube; says why.
    """
    path, check = file("path", path), flag("check", check)
    if path.is_dir():
        path = path / "certificate.json"
    name = path.parent.name if path.name == "certificate.json" else path.name
    for suffix in SUFFIXES:
        name = name.removesuffix(suffix)
    try:
        document = read_json(path)
        tube = replace(tube_of(document, name), origin=Origin(str(path)))
    except (Unreadable, ValueError) as error:
        raise InputError(f"{path}: expected the certificate of a tube ({error})") from None
    if check and (report := check_document(document)).outcome is not Outcome.PROVEN:
        raise InputError(f"{path}: the certificate does not prove its tube ({report.message})")
    return tube


def library_files() -> list[Path]:
    """The certificates that came with the package."""
    folder = resources.files("cfjax.tubes") / "library"
    return sorted(Path(str(entry)) for entry in folder.iterdir() if entry.name.endswith(SUFFIXES))


def library(vehicle: Vehicle = KinematicBicycle()) -> tuple[CertifiedTube, ...]:
    """The package's tubes for this vehicle, unchanged where it can do what the Parkour car can, else by similarity.

    Their proofs were replayed when the package was made, and can be again: `python -m cfjax.check FILE` for each of
    `library_files()`.

    Raises:
        InputError: for a vehicle of a kind that has no tubes.
    """
    instance("vehicle", vehicle, Vehicle)
    return _library(vehicle)


@lru_cache
def _library(vehicle: Vehicle) -> tuple[CertifiedTube, ...]:
    found = (for_vehicle(tube, vehicle) for tube in proven_tubes())
    return tuple(tube for tube in found if tube is not None)


@lru_cache
def proven_tubes() -> tuple[CertifiedTube, ...]:
    """The package's tubes as they were proven, for the Parkour car."""
    return tuple(read_tube(path, check=False) for path in library_files())


def pack(text: str) -> bytes:
    """A certificate's text as it lies in the library."""
    return lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME)
