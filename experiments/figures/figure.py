"""What all figures share: certified runs that are made once, cars, and what is left behind."""

import dataclasses
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cfjax.conf import options_of, preset, problem_of, yaml_of
from cfjax.control import law_named
from cfjax.errors import InputError
from cfjax.plants import plant_named, sensor_named
from cfjax.report.files import RESULT, versions, write_whole
from cfjax.report.run_folder import read_run, write_run
from cfjax.report.style import SERIES_COLOURS, STYLE
from cfjax.result import Result
from cfjax.simulation.controller import Follower
from cfjax.simulation.sampled import SampledLoop, drive_sampled
from cfjax.simulation.track import track_of
from cfjax.synthesis import search
from cfjax.verdict import Verdict


PF_COLOUR, TT_COLOUR = SERIES_COLOURS[0], SERIES_COLOURS[4]  # blue and red, as in the paper's figures of the circle
COLOURS = {"pf": PF_COLOUR, "tt": TT_COLOUR}
NAMES = {"pf": "path following", "tt": "trajectory tracking"}
DPI, LARGEST = 150, 250_000  # of a picture; bytes

Row = dict[str, Any]


@dataclass(frozen=True)
class Setting:
    """As on the command line."""

    output: Path
    runs: Path
    template: str
    law: str
    cars: int
    mpc_cars: int
    seed: int


@dataclass(frozen=True)
class Claim:
    """What the paper says, what is measured here, and whether they agree; None where that cannot be decided."""

    paper: str
    here: str
    agrees: bool | None


@dataclass(frozen=True)
class Drawn:
    """A figure, the numbers under it, and the paper's text beside them."""

    figure: Figure
    rows: Sequence[Row]
    claims: Sequence[Claim] = ()


def certified(setting: Setting, path: str, method: str, template: str | None = None) -> Result:
    """The certified run of a preset, from its folder or made now. `result.json` is written last, so what was
    interrupted is made again.

    Raises:
        InputError: nothing was certified, or the folder holds something else.
    """
    template = template or setting.template
    folder = setting.runs / f"{path}-{template}-{method}"
    if not (folder / RESULT).exists():
        print(f"making {folder}", flush=True)
        config = preset(path, [f"method={method}", f"template={template}", "cars=0", "robustness=false"])
        write_run(search(problem_of(config), options_of(config)), folder, yaml_of(config))
    result = read_run(folder)
    if result.verdict is not Verdict.CERTIFIED:
        raise InputError(f"{folder}: expected a certified run, this one is {result.verdict.value}")
    found = result.problem.path.name, result.problem.method.value, result.segments[0].funnel.template.name
    if found != (path, method, template):
        raise InputError(f"{folder}: expected a run of {path}, {method}, {template}; got {', '.join(found)}")
    return result


def drive(
    setting: Setting,
    result: Result,
    starts: Float[np.ndarray, "k n"],
    *,
    period: float = 0.01,
    plant: str = "model",
    noise: str = "none",
    laps: int = 1,
    recorded: int | None = None,
    limit: float | None = None,
    law: str | None = None,
) -> SampledLoop:
    """Cars from these states, all at θ = 0 as in the paper; leaving S stops none. Periods in s."""
    problem = result.problem
    follower = Follower(track_of(problem, result.legs, laps), period, law_named(law or setting.law))
    return drive_sampled(
        problem,
        result.legs,
        follower,
        plant_named(plant, problem.vehicle),
        starts,
        period=period,
        sensor=sensor_named(noise, problem.vehicle),
        theta=np.zeros(len(starts)),
        laps=laps,
        seed=setting.seed,
        stop=False,
        limit=limit,
        recorded=len(starts) if recorded is None else recorded,
    )


def driven(loop: SampledLoop, car: int) -> slice:
    """The samples of a recorded car up to the end of its drive."""
    return slice(0, int(np.argmax(loop.samples.clock[:, car])) + 1)


def finish(name: str, setting: Setting, drawn: Drawn) -> None:
    """Write NAME.png and NAME.json, and print what stands in the latter."""
    save_picture(drawn.figure, setting.output / f"{name}.png")
    question = {"figure": name, "template": setting.template, "law": setting.law, "seed": setting.seed}
    content = {
        **question,
        "rows": [{key: _plain(value) for key, value in row.items()} for row in drawn.rows],
        "claims": [dataclasses.asdict(claim) for claim in drawn.claims],
        "versions": versions(),
    }
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    write_whole(setting.output / f"{name}.json", (text + "\n").encode())
    console = Console(width=150)
    console.print(table_of(drawn.rows, f"{name}: V {setting.template}, law {setting.law}"))
    if drawn.claims:
        table = Table("the paper", "here", "agrees", show_lines=True)
        for claim in drawn.claims:
            table.add_row(escape(claim.paper), escape(claim.here), {True: "yes", False: "no", None: "–"}[claim.agrees])
        console.print(table)
    print(f"written to {setting.output}")


def save_picture(figure: Figure, path: Path) -> None:
    """With a palette of 256 colours, which nobody sees and which makes it small.

    Raises:
        ValueError: it is larger all the same.
    """
    drawn, packed = io.BytesIO(), io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(drawn, format="png", dpi=DPI)
    with Image.open(drawn) as picture:
        picture.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(packed, format="png", optimize=True)
    if len(packed.getvalue()) > LARGEST:
        raise ValueError(f"{path}: expected at most {LARGEST} bytes, got {len(packed.getvalue())}")
    write_whole(path, packed.getvalue())


def table_of(rows: Sequence[Row], title: str) -> Table:
    table = Table(*rows[0], title=title, title_justify="left")
    for row in rows:
        table.add_row(*(f"{value:.4g}" if isinstance(value, float) else str(value) for value in row.values()))
    return table


def _plain(value: Any) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not np.isfinite(value) else value
