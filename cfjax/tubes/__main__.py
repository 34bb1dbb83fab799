"""`python -m cfjax.tubes POINTS`: prove a path through points by the tubes of the package.

Exit code 0: a chain of tubes holds it, and the proof is written where --certificate says; 2: bad input, or no chain
does; one line on stderr says where and by how much.
"""

import argparse
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m cfjax.tubes", description="Prove a path through points by the tubes of the package."
    )
    parser.add_argument(
        "points", metavar="POINTS", type=Path, help="a text file with columns x and y (m), perhaps speed"
    )
    parser.add_argument("--speed", type=float, metavar="M/S", help="the most; default: the file's, or 2")
    parser.add_argument("--lateral-acceleration", type=float, default=4.0, metavar="M/S²", help="the most (4)")
    parser.add_argument("--acceleration", type=float, default=1.0, metavar="M/S²", help="the most (1)")
    parser.add_argument("--smoothing", type=float, default=0.0, metavar="M", help="how far the curve may be off (0)")
    parser.add_argument("--lap", action="store_true", default=None, help="it is one, though its ends do not meet")
    parser.add_argument(
        "--corridor",
        nargs="+",
        metavar="M",
        help="half-widths left and right (or one for both), two files of points, or: file, for the widths in POINTS",
    )
    parser.add_argument(
        "--footprint", nargs=2, type=float, action="append", metavar=("R", "OFFSET"), help="a disc of the body (0.25 0)"
    )
    parser.add_argument("--certificate", type=Path, metavar="FILE", help="where the proof goes")
    given = parser.parse_args(arguments)

    from cfjax.errors import InputError
    from cfjax.problem.obstacles import FootprintDisc
    from cfjax.problem.point_path import waypoints
    from cfjax.tubes import follow, write_chain

    try:
        path = waypoints(
            given.points,
            closed=given.lap,
            speed=given.speed,
            lateral_acceleration=given.lateral_acceleration,
            acceleration=given.acceleration,
            smoothing=given.smoothing,
        )
        print(path.source)
        if path.doubt:
            print(f"warning: {path.doubt}", file=sys.stderr)
        body = given.footprint or [FootprintDisc()]
        found = follow(path, closed=path.closed, corridor=_corridor(given.corridor), footprint=body)
        print(found)
        if given.certificate:
            write_chain(found, given.certificate)
            print(f"certificate: {given.certificate}")
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: {error.filename}: cannot be read or written ({error.strerror})", file=sys.stderr)
        return 2
    return 0


def _corridor(given: list[str] | None) -> object:
    """What `follow` takes, of words: a number each, else a name."""

    def meant(word: str) -> float | str:
        try:
            return float(word)
        except ValueError:
            return word

    words = None if given is None else [meant(word) for word in given]
    if words is None or len(words) == 1:
        return words and words[0]
    return dict(zip(("left", "right", *map(str, range(len(words)))), words, strict=False))


if __name__ == "__main__":
    sys.exit(main())
