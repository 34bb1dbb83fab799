"""`python -m cfjax.simulate FOLDER`: a certified run's closed loop, sampled, on a plant that need not be the model.

Exit code: 0 done; 2 bad input, one line on stderr; 130 interrupted. The last line printed is `simulation: FOLDER`.
"""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn


if TYPE_CHECKING:
    from cfjax.simulation.experiment import Experiment

BAD_INPUT, INTERRUPTED = 2, 130
EPILOG = """\
plants, NAME or NAME:key=value,… (SI units; steering in rad, thrust in m/s^2):
  model[:wheelbase=m]       the vehicle of the run; with another wheelbase than the controller knows
  disturbed:[KIND,]x=m/s,…  with a disturbance of the rates of alpha (rad/s), x, y (m/s), v (m/s^2), or bound= for all;
                            KIND is random (uniform, anew every hold=0.1 s), constant, or adversarial (raises V most)
  single_track[:…]          tyre slip, load transfer, steering servo: stiffness=1 (factor), lag=s, rate=rad/s,
                            friction=, mass=kg, inertia=kg m^2, height=m
  commonroad[:lag=s]        CommonRoad's multi-body car, wheelbase 2.58 m; slow: tens of cars  (extra: plants)
  slipx                     SlipX's double track, wheelbase 0.32 m; tens of cars               (extra: plants)

noise, words and key=value, separated by commas:
  none; mocap (heading=0.003,position=0.001,speed=0.02); wifi (delay=0.02,jitter=0.02,loss=0.05)
  heading=rad, position=m, speed=m/s       standard deviations
  bias_heading=rad, bias_x=m, bias_y=m, bias_speed=m/s
  delay=s, jitter=s                        a pose is delay + jitter * U old, U uniform in [0, 1]
  loss=share                               of samples that do not arrive: the last one stands
"""


class Parser(argparse.ArgumentParser):
    """One that complains in one line."""

    def error(self, message: str) -> NoReturn:
        print(f"error: {message}", file=sys.stderr)
        raise SystemExit(BAD_INPUT)


def main(arguments: list[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    try:
        return _main(options)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def parser() -> Parser:
    made = Parser(
        prog="python -m cfjax.simulate",
        description="Drive the cars of a certified run: a sampled controller, a plant, a sensor between them.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument("folder", metavar="FOLDER", type=Path, help="a run's folder")
    made.add_argument("--plant", default="model", help="what is driven (below); default: model")
    made.add_argument("--noise", default="none", help="what the controller sees (below); default: none")
    made.add_argument(
        "--law", default="min_norm", help="min_norm (default), sontag, lin_sontag; sampled: of a run with period=…"
    )
    made.add_argument("--n", type=int, metavar="CARS", help="default: 1000, of other people's plants 20")
    made.add_argument(
        "--period",
        type=float,
        metavar="S",
        help="of control; default: 0.005, or a 500th of the path; with --law sampled the one that is proven",
    )
    made.add_argument(
        "--starts",
        default="random",
        metavar="random|worst|FILE.csv",
        help="random: of I; worst: on the funnel's inlet, where V can be made to fall least; a file: columns "
        "alpha (rad; or yaw, as ROS counts it), x, y (m), v (m/s) in the world frame",
    )
    made.add_argument(
        "--frame", help="of headings in cars.csv: paper, alpha from +y; ros, yaw from +x; default: the run's"
    )
    made.add_argument("--seed", type=int, default=0, help="of starts, noise and disturbance; default: 0")
    made.add_argument("--laps", type=int, default=1, help="of a path that closes; default: 1")
    made.add_argument(
        "--path",
        type=Path,
        metavar="FILE",
        help="of a tube: points of the path, a CSV file with x and y (m); default: one that winds from one end of the "
        "tube's curvatures to the other",
    )
    made.add_argument("--vehicle", metavar="module.Class", help="of a run of your own vehicle: its class")
    made.add_argument("--out", type=Path, metavar="DIR", help="where to write; default: FOLDER/simulation")
    made.add_argument(
        "--animate",
        action="store_true",
        help="draw a car in the funnel: simulation.gif, which needs nothing that is not installed with the package",
    )
    return made


def _main(options: argparse.Namespace) -> int:
    from cfjax.train import prepare_environment

    prepare_environment()

    from cfjax.errors import InputError
    from cfjax.report.simulated import print_summary, write_simulation
    from cfjax.simulation.experiment import run_experiment

    output = options.out or options.folder / "simulation"
    try:
        experiment = experiment_of(options)
        output.mkdir(parents=True, exist_ok=True)
        loop = run_experiment(experiment)
        write_simulation(experiment, loop, output, animate=options.animate)
    except InputError as error:
        message = str(error)
    except OSError as error:
        message = f"--out: cannot write to {output} ({error.strerror or error})"
    else:
        print_summary(experiment, loop)
        print(f"simulation: {output}", flush=True)
        return 0
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return BAD_INPUT


def experiment_of(options: argparse.Namespace) -> "Experiment":
    """Read the run, for a tube's run prove it along a path, and set up the experiment.

    Raises:
        InputError: says what was expected.
    """
    from cfjax.errors import InputError
    from cfjax.report.run_folder import read_frame, read_run
    from cfjax.simulation.experiment import Setup, set_up
    from cfjax.tubes.along import along_path
    from cfjax.verdict import Verdict

    setup = Setup(**{field.name: getattr(options, field.name) for field in dataclasses.fields(Setup)})
    result = read_run(setup.folder, setup.vehicle)
    if result.verdict is not Verdict.CERTIFIED:
        raise InputError(f"{setup.folder}: expected a certified run, this one is {result.verdict.value}")
    frame = read_frame(setup.folder)
    if result.problem.path.tube or setup.path:
        result = along_path(result, setup.path)
    return set_up(setup, result, frame)


if __name__ == "__main__":
    sys.exit(main())
