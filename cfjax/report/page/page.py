"""From a result to report.html: what is said and shown, in order; the page itself is `page.html.j2` with its style."""

import json
import tempfile
import time
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2

from cfcheck import check_document
from cfjax import coerce
from cfjax.certificate.writing import dump
from cfjax.errors import InputError
from cfjax.report.files import CONFIG, REPORT, RESULT, read_json, versions, write_whole
from cfjax.report.page import tables
from cfjax.report.page.figure import Figure, figure_of
from cfjax.report.page.space import space_of
from cfjax.report.panels import shown_of
from cfjax.report.run_folder import as_proven
from cfjax.result import Result
from cfjax.verdict import Verdict


TITLES = {
    Verdict.CERTIFIED: "certified",
    Verdict.REFUTED: "refuted",
    Verdict.INCONCLUSIVE: "inconclusive",
    Verdict.SOLVER_FAILED: "solver failed",
}

POINTS = 5000  # of all cars together
LABELS = {
    "plane": "The funnel, the reference and the cars on the plane",
    "values": "V along the way of the cars",
    "inputs": "Inputs of the cars against their limits",
    "margins": "The margin along the path, certified and falsified",
    "sections": "Shadows of the funnel, of I and of G on pairs of states",
}


def save_page(result: Result, path: Path) -> None:
    """Write the page of a run into its folder, whose configuration it shows: one file, self-contained.

    It says what the result says: a `certified` one has to come from a folder whose certificate the checker accepted.
    """
    folder = path.parent
    config = (folder / CONFIG).read_text("utf-8") if (folder / CONFIG).exists() else ""
    known = read_json(folder / RESULT)["versions"] if (folder / RESULT).exists() else versions()
    path.write_text(page_of(result, config, known), encoding="utf-8")


def write_report(result: Result, path: Path | str | None = None) -> Path:
    """Write the page of a result that need not lie in a run folder, and return where it is; `result.report()` does it.

    What the result claims is checked first, from the text of its certificate, and the page repeats the checker's
    account. What funnels absorb is proven in run folders: their pages are `python -m cfjax.report FOLDER`.

    Args:
        result: what `cfjax.synthesize` returned, for example.
        path: of the page; one that is there is replaced. None: `report.html` in a new temporary folder.

    Raises:
        InputError: where the checker does not accept what the result claims, or the page cannot be written.
    """
    coerce.instance("result", result, Result)
    shown = as_proven(result, lambda: check_document(json.loads(dump(result.document or {}))), "result")
    file = Path(tempfile.mkdtemp(prefix="cfjax-")) / REPORT if path is None else coerce.file("path", path)
    if file.is_dir():
        raise InputError(f"path: expected the name of a file, got the folder {file}")
    try:
        write_whole(file, page_of(shown, "", versions()).encode())
    except OSError as error:
        raise InputError(f"path: cannot write to {file} ({error.strerror or error})") from error
    return file


def page_of(result: Result, config: str, known: dict[str, str]) -> str:
    """The page's text; `known` are the versions that made the result."""
    shown = shown_of(result, POINTS)
    cars, space = shown.cars, space_of(result, shown)
    figures = [space] if space else []
    figures += [
        figure_of(name, label, shown.panels[name], beside=name == "sections")
        for name, label in LABELS.items()
        if name in shown.panels
    ]
    return (
        environment()
        .get_template("page.html.j2")
        .render(
            result=result,
            verdict=TITLES[result.verdict],
            tone=result.verdict.value,
            meaning=tables.MEANING[result.verdict],
            account=result.account or (result.message,),
            facts=tables.facts(result),
            parameters=tables.parameters(result),
            figures={figure.name: figure for figure in figures},
            data=_script_json({figure.name: _data(figure) for figure in figures}),
            funnels=tables.funnels(result) if result.segments else None,
            worst=tables.worst_points(result) if result.worst_points else None,
            extremes=tables.extremes(result, [car.inputs for car in cars]) if cars else None,
            shown=len(cars),
            driven=asdict(result.closed_loop) if result.closed_loop else None,
            absorbed=tables.absorbed(result) if result.robustness else None,
            rounds=tables.rounds(result) if result.history else None,
            seconds=tables.seconds(result),
            total=result.seconds.get("total"),
            versions=known,
            config=config,
            written=time.strftime("%Y-%m-%d %H:%M"),
            plotly=plotly_script(),
            style=text_of("page.css"),
            script=text_of("page.js"),
        )
    )


def environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(text_of), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )


def text_of(name: str) -> str:
    """Of a file beside this one."""
    return resources.files("cfjax.report.page").joinpath(name).read_text("utf-8")


def plotly_script() -> str:
    """The whole of plotly.js, as it travels with the package of that name."""
    return resources.files("plotly").joinpath("package_data/plotly.min.js").read_text("utf-8")


def _data(figure: Figure) -> dict[str, Any]:
    return {"traces": figure.traces, "layout": figure.layout, "views": figure.views, "shape": figure.shape}


def _script_json(data: Any) -> str:
    """JSON that may stand inside a script: nothing in it ends one."""
    return json.dumps(data, allow_nan=False, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")
