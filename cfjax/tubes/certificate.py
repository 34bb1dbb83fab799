"""The proof that a path is followed, as a file: the path in exact numbers, and every tube's own certificate whole."""

from pathlib import Path
from typing import Any

from cfjax.check.chain import CHAIN
from cfjax.check.document import FORMAT, VERSION, document_hash
from cfjax.check.rational import rational
from cfjax.check.reader import read_json
from cfjax.check.reference import CertifiedTube
from cfjax.errors import InputError
from cfjax.exact import write_pieces
from cfjax.tubes.follow import Following


def chain_document(following: Following) -> dict[str, Any]:
    """What `python -m cfjax.check FILE` replays: tubes, bounds along the path, links and closure.

    Raises:
        InputError: where a tube was not read from a file.
    """
    tubes = list(dict.fromkeys(run.tube for run in following.runs))
    content = {
        "format": FORMAT,
        "version": VERSION,
        "claim": CHAIN,
        "vehicle": {
            "name": tubes[0].vehicle,
            "parameters": {name: str(value) for name, value in tubes[0].parameters.items()},
        },
        "path": {
            "name": following.path.name,
            "closed": following.closed,
            "start": [str(rational(float(value))) for value in following.path.curve[0].start],
            "pieces": write_pieces(following.reference.pieces),
        },
        "tubes": [_tube(tube) for tube in tubes],
        "runs": [{"end": run.end, "tube": tubes.index(run.tube)} for run in following.runs],
        "levels": [str(level) for level in following.levels],
    }
    return {**content, "hash": document_hash(content)}


def _tube(tube: CertifiedTube) -> dict[str, Any]:
    if tube.origin is None:
        raise InputError(f"certificate: expected tubes that were read from files, {tube.name} was not")
    source, length, speed = tube.origin
    return {"certificate": read_json(Path(source)), "length": str(length), "speed": str(speed)}


def write_chain(following: Following, path: str | Path) -> None:
    """Write the proof that the path is followed; the file says PROVEN to the checker, or is none of ours.

    Raises:
        InputError: as `chain_document`; OSError where the file cannot be written.
    """
    from cfjax.certificate.writing import dump  # here, for the solvers come with it

    Path(path).write_text(dump(chain_document(following)), encoding="ascii")
