"""The controller of a certified run as a package of ROS 2: a node in C++ around the source in C.

The files of the package stand in `ament/` beside this one. Those that end in `.in` are filled in; the others are the
same for every run.
"""

from collections.abc import Iterator
from decimal import Decimal
from importlib import resources
from os import PathLike
from pathlib import Path
from string import Template as Text

import shapely

from cfjax.coerce import file, instance
from cfjax.errors import InputError
from cfjax.export.controller import HEADER, SOURCE, sources_of
from cfjax.export.graph_c import number
from cfjax.problem import KinematicBicycle, Vehicle
from cfjax.report.files import write_whole
from cfjax.report.marks import Points, rings_of
from cfjax.report.plane import Plane
from cfjax.result import Result
from cfjax.rounded import rounded_down


FILES = (
    "README.md",
    "package.xml",
    "CMakeLists.txt",
    "src/node.cpp",
    "include/core.hpp",
    "include/run.hpp.in",
    "launch/follow.launch.xml",
    "config/parameters.yaml.in",
)
SLOWEST = 0.01  # s: the control period that parameters begin with is no longer than this
NEAR = 1e-3  # m: so far may an outline for the eye be from the funnel's


def write_package(result: Result, folder: str | PathLike[str]) -> list[Path]:
    """Write an ament package into `folder`, each file whole or not at all; returns their paths.

    Its node takes odometry (REP 103, m, rad, m/s), and tells a steering angle (rad), a speed (m/s) and an acceleration
    (m/s²). See `docs/ros2.md`.

    Raises:
        InputError: where the run has no controller (`sources_of`), or its vehicle is no kinematic bicycle.
    """
    folder, texts = file("folder", folder), _texts(instance("result", result, Result))
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_whole(folder / name, text.encode())
    return [folder / name for name in texts]


def _texts(result: Result) -> dict[str, str]:
    """The files of the package by their paths in it."""
    sources = sources_of(result)
    _check_vehicle(result.problem.vehicle)
    fields, room = _fields(result), resources.files("cfjax.export") / "ament"
    texts = {}
    for name in FILES:
        text = room.joinpath(name).read_text("utf-8")
        texts[name.removesuffix(".in")] = Text(text).substitute(fields) if name.endswith(".in") else text
    return texts | {f"include/{HEADER}": sources.header, f"src/{SOURCE}": sources.source}


def _check_vehicle(vehicle: Vehicle) -> None:
    if not isinstance(vehicle, KinematicBicycle) or vehicle.internal_names != KinematicBicycle.internal_names:
        raise InputError(
            f"export --ros2: expected a run of the kinematic bicycle, whose state odometry holds and whose commands "
            f"are Ackermann's, got one of {vehicle.name}; without --ros2 its controller is written in C alone"
        )


def _fields(result: Result) -> dict[str, str]:
    """What a run adds to the package, beside its controller."""
    plane = Plane(result)
    period = result.robustness.alone.period if result.robustness else 0.0
    rings = rings_of(shapely.simplify(plane.funnel, NEAR))
    return {
        "proven_period": rounded_down(period),
        "proven": f"at most {rounded_down(period)} s" if period else "nothing",
        "period": format(Decimal(rounded_down(min(period, SLOWEST) or SLOWEST, 2)), "f"),  # YAML 1.1 has no 1e-05
        "path": ",\n".join(_points(plane.line)),
        "funnel": ",\n".join(f"Line{{\n{text}}}" for text in map(",\n".join, map(_points, rings))),
    }


def _points(points: Points) -> Iterator[str]:
    return (f"    {{{number(round(float(x), 6))}, {number(round(float(y), 6))}}}" for x, y in points)
