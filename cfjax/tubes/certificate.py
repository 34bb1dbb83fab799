"""The proof that a path is followed, as a file: the path in exact numbers, and every tube's own certificate whole."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cfjax.check.certified import CertifiedTube
from cfjax.check.chain import CHAIN
from cfjax.check.document import FORMAT, VERSION, document_hash
from cfjax.check.rational import rational
from cfjax.check.reader import read_json
from cfjax.coerce import file, instance, optional
from cfjax.errors import InputError
from cfjax.exact import exact_numbers, exact_surroundings, write_clearance, write_pieces, write_surroundings
from cfjax.problem import Problem
from cfjax.tubes.follow import Following


def chain_document(following: Following, problem: Problem | None = None) -> dict[str, Any]:
    """What `python -m cfjax.check FILE` replays: tubes, bounds along the path, links and closure.

    With a problem the file claims its sets too: from I, inside S, to G.

    Raises:
        InputError: where a tube came without its certificate, or the path was not followed beside the problem's
            obstacles.
    """
    instance("following", following, Following)
    optional("problem", problem, Problem)
    if problem and exact_surroundings(problem.obstacles, problem.footprint) != following.surroundings:
        raise InputError("following: expected a path that was followed beside the problem's obstacles")
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
        "sets": None if problem is None else _sets(problem),
        "tubes": [_tube(tube) for tube in tubes],
        "runs": [{"end": run.end, "tube": tubes.index(run.tube)} for run in following.runs],
        "levels": [str(level) for level in following.levels],
        "surroundings": write_surroundings(following.surroundings),
        "clearance": write_clearance(following.clearance),
    }
    return {**content, "hash": document_hash(content)}


def _tube(tube: CertifiedTube) -> dict[str, Any]:
    if tube.origin is None:
        raise InputError(f"certificate: expected tubes with their certificates, {tube.name} has none")
    source, length, speed = tube.origin
    certificate = source if isinstance(source, dict) else read_json(Path(source))
    return {"certificate": certificate, "length": str(length), "speed": str(speed)}


def _sets(problem: Problem) -> dict[str, Any]:
    def axes(values: Sequence[float]) -> list[str]:
        return [str(value) for value in exact_numbers(values)]

    return {
        "inlet": axes(problem.inlet.half_axes),
        "goal": axes(problem.goal_axes),
        "safe": axes(problem.safe.half_widths) if problem.safe else None,
    }


def write_chain(following: Following, path: str | Path) -> None:
    """Write the proof that the path is followed; the file says PROVEN to the checker, or is none of ours.

    Raises:
        InputError: as `chain_document`; OSError where the file cannot be written.
    """
    from cfjax.certificate.writing import dump  # here, for the solvers come with it

    file("path", path).write_text(dump(chain_document(following)), encoding="ascii")
