#!/usr/bin/env python
"""What somebody new does from Python: mistakes, files of points, other vehicles, and the help of every command.

    python scripts/newcomer_python.py [--without-vehicles]

Prints a line for each part. Exit code 1, with a line, where something is not as a newcomer has to find it: a mistake
gets one line that says what to write, a vehicle is certified and has its page, a file is read or its remedy is named.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import cfjax
from cfjax import InputError, Options, Problem, Verdict, circle, waypoints
from cfjax.__main__ import COMMANDS
from experiments.vehicle_table import SETS
from experiments.vehicles.dynamic_single_track import DynamicSingleTrack
from experiments.vehicles.omnidirectional import Omnidirectional
from experiments.vehicles.steered_car import SteeredCar


SMALL = Options(cars=20, restarts=1, rounds=1)
HELP_SECONDS = 5.0  # a command's help, on a busy machine too

new: Any = cfjax  # a newcomer has no type checker
MISTAKES: dict[str, tuple[Callable[[], object], str]] = {  # what is written, and what the line has to name
    "a path by its name": (lambda: new.Problem("circle"), "path: expected a Path"),
    "a method that is none": (lambda: new.Problem(circle(), method="tracking"), "method: expected"),
    "half-widths of three states": (lambda: new.Problem(circle(), safe=(1, 1, 1)), "safe: expected"),
    "a vehicle by its name": (lambda: new.Problem(circle(), vehicle="car"), "vehicle: expected"),
    "a negative radius": (lambda: new.circle(radius=-1), "radius: expected"),
    "a radius as text": (lambda: new.circle(radius="1.5 m"), "radius: expected"),
    "a template that is none": (lambda: new.Options(template="contracted"), "template: expected"),
    "half a car": (lambda: new.Options(cars=0.5), "cars: expected"),
    "a file that is not there": (lambda: new.waypoints("no_such_file.csv"), "no_such_file.csv"),
    "a path in place of the problem": (lambda: new.synthesize(circle()), "problem: expected a Problem"),
    "a panel that is none": (lambda: new.Result("inconclusive", "none", Problem(circle())).plot("sped"), "panel"),
}
VEHICLES = {
    "three states": Problem(
        circle(laps=0.5), vehicle=Omnidirectional(), inlet=cfjax.ball(0.4, 3), goal=cfjax.ball(1.2, 3)
    ),
    "five states": Problem(cfjax.straight(), vehicle=SteeredCar(), method="tt", **SETS["steered_car"]),
    "six states": Problem(circle(), vehicle=DynamicSingleTrack(), method="tt", **SETS["dynamic_single_track"]),
}


def mistakes() -> list[str]:
    """A line for each one that is not refused in one line with its words."""
    found = []
    for name, (call, words) in MISTAKES.items():
        try:
            call()
        except InputError as error:
            if words not in str(error) or "\n" in str(error):
                found.append(f"{name}: expected {words!r} in one line, got {error}")
        else:
            found.append(f"{name}: not refused")
    return found


def point_files(folder: Path) -> list[str]:
    """A noisy lap is refused with the smoothing that helps, which then does; an open lap says that it is one."""
    turn = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    lap = 3 * np.column_stack([np.cos(turn), np.sin(turn)])
    noisy, open_ = folder / "noisy.csv", folder / "open.csv"
    np.savetxt(noisy, lap + np.random.default_rng(0).normal(scale=0.03, size=lap.shape), delimiter=",")
    np.savetxt(open_, lap[:60], delimiter=",")
    found = []
    try:
        waypoints(noisy)
        found.append("noise of 3 cm: not refused")
    except InputError as error:
        advice = str(error).partition("path.smoothing=")[2].partition(" ")[0]
        if not advice:
            found.append(f"noise of 3 cm: expected the smoothing that helps, got {error}")
        elif not waypoints(noisy, smoothing=float(advice)).closed:
            found.append("noise of 3 cm: the lap is not closed")
    path = waypoints(open_)
    if path.closed or "open" not in (path.source or ""):
        found.append(f"three quarters of a lap: expected an open path, got {path.source}")
    return found


def vehicle(problem: Problem, folder: Path) -> list[str]:
    """Certified, driven, with its page."""
    result = cfjax.synthesize(problem, SMALL)
    name = problem.vehicle.name
    if result.verdict is not Verdict.CERTIFIED or result.closed_loop is None:
        return [f"{name}: expected certified, got {result!r}"]
    page = result.report(folder / f"{name}.html").read_text("utf-8")
    return [] if "accepted the certificate" in page else [f"{name}: its page does not say what is proven"]


def helps() -> list[str]:
    """`cfjax --help`, and that of every command: exit code 0, how it is called, and soon."""
    found = []
    for name in ("", *COMMANDS):
        begin = time.perf_counter()
        command = [sys.executable, "-m", "cfjax", *([name] if name else []), "--help"]
        process = subprocess.run(command, capture_output=True, text=True, check=False)
        seconds = time.perf_counter() - begin
        if process.returncode or process.stderr or "cfjax" not in process.stdout or seconds > HELP_SECONDS:
            found.append(f"cfjax {name} --help: exit code {process.returncode}, {seconds:.1f} s, {process.stderr}")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--without-vehicles", action="store_true", help="which take a minute or two")
    vehicles = {} if parser.parse_args().without_vehicles else VEHICLES
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        parts: dict[str, Callable[[], list[str]]] = {
            f"{len(MISTAKES)} mistakes": mistakes,
            "noisy and open points": lambda: point_files(folder),
            f"the help of {1 + len(COMMANDS)} commands": helps,
            **{name: lambda own=own: vehicle(own, folder) for name, own in vehicles.items()},
        }
        for name, part in parts.items():
            begin = time.perf_counter()
            if wrong := part():
                print("\n".join(wrong), file=sys.stderr)
                return 1
            print(f"newcomer: {name}, {time.perf_counter() - begin:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
