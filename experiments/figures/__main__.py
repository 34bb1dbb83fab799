"""Draw a figure: certified runs are made once and kept, cars are driven, numbers and the paper's claims are printed.

    python -m experiments.figures straight|rounds|starts|oval|obstacle|robustness [--output FOLDER] …

A figure leaves NAME.png and NAME.json. Runs lie in FOLDER/runs and are used again; one that was interrupted is made
anew. The paper's own V and law are --template paper --law sontag, which is the default but for robustness.
"""

import argparse
import importlib
import os
import sys
from pathlib import Path

from cfjax.train import prepare_environment


FIGURES = ("straight", "rounds", "starts", "oval", "obstacle", "robustness")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=FIGURES)
    parser.add_argument("--output", type=Path, default=Path("outputs/figures"), metavar="FOLDER")
    parser.add_argument("--runs", type=Path, metavar="FOLDER", help="certified runs; default: OUTPUT/runs")
    parser.add_argument("--template", choices=("paper", "contracting"), help="of V")
    parser.add_argument("--law", choices=("sontag", "min_norm", "lin_sontag"), help="that drives")
    parser.add_argument("--cars", type=int, help="a point of robustness, or where a figure counts: default 1000")
    parser.add_argument(
        "--mpc-cars", type=int, help="of the MPC tracker, a point of robustness; default: as the others"
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    prepare_environment()
    if options.name == "robustness":  # the MPC tracker's compiler option, before JAX is loaded
        os.environ.setdefault("XLA_FLAGS", "--xla_disable_hlo_passes=cse_barrier_expander")

    from cfjax.errors import InputError
    from experiments.figures.figure import Setting, finish

    own = options.name == "robustness"
    setting = Setting(
        output=options.output,
        runs=options.runs or options.output / "runs",
        template=options.template or ("contracting" if own else "paper"),
        law=options.law or ("min_norm" if own else "sontag"),
        cars=options.cars or 1000,
        mpc_cars=options.mpc_cars or options.cars or 1000,
        seed=options.seed,
    )
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        finish(options.name, setting, importlib.import_module(f"experiments.figures.{options.name}").make(setting))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
