"""`python -m cfjax.planner MAP`: a certified path through a map, from a start to a goal.

Exit code 0: it is proven, and the proof is written where --certificate says; 2: bad input, or no path is proven; one
line on stderr says where and by how much.
"""

import argparse
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m cfjax.planner", description="Find a path through a map, and prove that a car on it is clear."
    )
    pose = {"type": float, "nargs": 3, "metavar": ("X", "Y", "HEADING")}
    kinds = "a .yaml of obstacles or of a ROS map server, GeoJSON, or CommonRoad's XML"
    parser.add_argument("map", metavar="MAP", type=Path, help=kinds)
    parser.add_argument("--start", **pose, help="m, m and rad, 0 along +y: yaw less pi/2; default: that of the scene")
    parser.add_argument("--goal", **pose, help="as the start")
    parser.add_argument("--wheelbase", type=float, metavar="M", help="of the car (0.34)")
    parser.add_argument("--speed", type=float, default=2.0, metavar="M/S", help="the most (2)")
    parser.add_argument("--lateral-acceleration", type=float, default=4.0, metavar="M/S²", help="the most (4)")
    parser.add_argument(
        "--footprint", nargs=2, type=float, action="append", metavar=("R", "OFFSET"), help="a disc of the body (0.25 0)"
    )
    parser.add_argument("--unknown-is-free", action="store_true", help="cells of a grid of which nothing is known")
    parser.add_argument("--certificate", type=Path, metavar="FILE", help="where the proof goes")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="where a picture goes: PNG, SVG or PDF")
    given = parser.parse_args(arguments)

    from cfjax.errors import InputError
    from cfjax.planner import plan, read_map
    from cfjax.problem import FootprintDisc, KinematicBicycle

    try:
        found = plan(
            read_map(given.map, unknown_is_free=given.unknown_is_free),
            given.start,
            given.goal,
            vehicle=None if given.wheelbase is None else KinematicBicycle(given.wheelbase),
            footprint=given.footprint or [FootprintDisc()],
            speed=given.speed,
            lateral_acceleration=given.lateral_acceleration,
        )
        print(found)
        if given.certificate:
            found.write(given.certificate)
            print(f"certificate: {given.certificate}")
        if given.picture:
            found.plot().savefig(given.picture)
            print(f"picture: {given.picture}")
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: {error.filename}: cannot be written ({error.strerror})", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
