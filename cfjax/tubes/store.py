"""The tubes that travel with the package: certificates in `library/`, one file each."""

import lzma
from functools import lru_cache
from importlib import resources
from pathlib import Path

from cfjax.check import Outcome, check_document
from cfjax.check.document import read_claims
from cfjax.check.reader import Unreadable, read_json
from cfjax.check.reference import CertifiedTube
from cfjax.check.tube import TubeClaim
from cfjax.check.vehicle import KNOWN_VEHICLES
from cfjax.errors import InputError
from cfjax.problem import KinematicBicycle, Vehicle
from cfjax.tubes.vehicles import for_vehicle


SUFFIXES = (".json.xz", ".json")


def read_tube(path: Path, *, check: bool = True) -> CertifiedTube:
    """The tube that a certificate proves; its name is that of the file (or, for certificate.json, of its folder).

    Without `check` the proof is not replayed: for files that were checked before.

    Raises:
        InputError: where the file proves no tube; says why.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "certificate.json"
    try:
        document = read_json(path)
        problem, (funnel, *_) = read_claims(document)
    except (Unreadable, ValueError) as error:
        raise InputError(f"{path}: expected the certificate of a tube ({error})") from None
    tube = problem.segments[0]
    if not isinstance(tube, TubeClaim) or funnel.margin_per_metre is None:
        raise InputError(f"{path}: expected the certificate of a tube, got one of something else")
    if problem.vehicle.name not in KNOWN_VEHICLES:  # any other name stands for no particular dynamics or states
        raise InputError(f"{path}: expected a vehicle out of {', '.join(KNOWN_VEHICLES)}, got {problem.vehicle.name}")
    if check and (report := check_document(document)).outcome is not Outcome.PROVEN:
        raise InputError(f"{path}: the certificate does not prove its tube ({report.message})")
    name = path.parent.name if path.name == "certificate.json" else path.name
    for suffix in SUFFIXES:
        name = name.removesuffix(suffix)
    return CertifiedTube(
        name=name,
        vehicle=problem.vehicle.name,
        parameters=problem.vehicle.parameters,
        method=problem.method,
        curvature=tube.curvature,
        speed=tube.speed,
        acceleration=tube.acceleration,
        shape=funnel.shape,
        beta_lower=funnel.beta_lower,
        beta_inner=funnel.beta_inner,
        margin=funnel.margin,
        margin_per_metre=funnel.margin_per_metre,
        inputs=problem.inputs,
    )


def library_files() -> list[Path]:
    """The certificates that came with the package."""
    folder = resources.files("cfjax.tubes") / "library"
    return sorted(Path(str(entry)) for entry in folder.iterdir() if entry.name.endswith(SUFFIXES))


@lru_cache
def library(vehicle: Vehicle = KinematicBicycle()) -> tuple[CertifiedTube, ...]:
    """The package's tubes for this vehicle, unchanged where it can do what the Parkour car can, else by similarity.

    Their proofs were replayed when the package was made, and can be again: `python -m cfjax.check FILE` for each of
    `library_files()`.

    Raises:
        InputError: for a vehicle of a kind that has no tubes.
    """
    found = (for_vehicle(tube, vehicle) for tube in _proven())
    return tuple(tube for tube in found if tube is not None)


@lru_cache
def _proven() -> tuple[CertifiedTube, ...]:
    return tuple(read_tube(path, check=False) for path in library_files())


def pack(text: str) -> bytes:
    """A certificate's text as it lies in the library."""
    return lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME)
