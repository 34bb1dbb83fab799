"""Certified margins against what a sweep varied: lines over one key of numbers, or a map over two."""

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from cfjax.report.style import SERIES_COLOURS, STYLE
from cfjax.report.table import SWEPT
from cfjax.rounded import margin_text


PICTURE = "margin.png"
LEAST_OF_A_MAP, LEAST_FILLED = 3, 0.5  # numbers along either side, and the part of pairs that was run
PANELS_ABREAST = 3
LABELS = {
    "path.speed": "speed (m/s)",
    "beta_lower": r"lower level of the shell $\beta$",
    "timing": r"interval of $u_0$",
}


def save_sweep_picture(table: pl.DataFrame, output: Path) -> Path | None:
    """Draw margin.png; None where nothing was varied but names, or no job has a verdict.

    Two swept keys of some numbers each, whose combinations were mostly run, span a map, one for each other choice.
    Else the key with the most numbers is the axis, with a line for each combination of the others.
    """
    done = table.filter(pl.col("certified").is_not_null() | pl.col("falsified").is_not_null())
    swept = [column for column in table.columns if column.startswith(SWEPT)]
    axes_of = [column for column in swept if not done[column].is_null().any() and _values(done[column]) is not None]
    if done.is_empty() or not axes_of:
        return None
    across, *more = sorted(axes_of, key=lambda column: done[column].n_unique(), reverse=True)
    others = [column for column in swept if column != across and table[column].n_unique() > 1]
    notes = []
    with mpl.rc_context(STYLE):
        if more and _is_grid(done, across, more[0]):
            figure = _map(done, across, more[0], [column for column in others if column != more[0]])
        else:
            figure = _lines(done, across, others)
            notes = ["open marks: nothing proven"] if table["certified"].is_null().any() else []
        if waiting := table.height - done.height:
            notes.append(f"{waiting} jobs without a verdict are left out")
        if notes:
            figure.suptitle("; ".join(notes), fontsize=8, color="#495057", x=0.01, ha="left")
        draft = output / f".part-{PICTURE}"
        figure.savefig(draft, dpi=200)
    draft.replace(output / PICTURE)
    return output / PICTURE


def _is_grid(done: pl.DataFrame, across: str, up: str) -> bool:
    """Whether two keys have some numbers each, and most pairs of them were run."""
    counts = [done[column].n_unique() for column in (across, up)]
    pairs = done.select(across, up).n_unique()
    return min(counts) >= LEAST_OF_A_MAP and pairs >= LEAST_FILLED * counts[0] * counts[1]


def _map(done: pl.DataFrame, across: str, up: str, others: list[str]) -> Figure:
    """A map for each choice of the others; cells tell the margin, rounded down, or that nothing is proven."""
    panels: dict[str, list[dict]] = {}
    for row in done.iter_rows(named=True):
        panels.setdefault(", ".join(_choice(c.removeprefix(SWEPT), str(row[c])) for c in others), []).append(row)
    columns = min(len(panels), PANELS_ABREAST)
    rows = math.ceil(len(panels) / columns)
    figure = Figure(figsize=(1.2 + 3.6 * columns, 3.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    ticks = [_ticks(done[column]) for column in (across, up)]
    most = max((row["certified"] for row in done.iter_rows(named=True) if row["certified"] is not None), default=1.0)
    drawn = None
    for place, (label, found) in zip(axes.flat, sorted(panels.items()), strict=False):
        margins = np.full((len(ticks[1]), len(ticks[0])), np.nan)
        for row in found:
            at = [list(numbers).index(_value(str(row[c]))) for numbers, c in zip(ticks, (across, up), strict=True)]
            proven = row["certified"]
            margins[at[1], at[0]] = np.nan if proven is None else proven
            text = "none" if proven is None else margin_text(proven)
            light = proven is not None and proven < 0.6 * most
            place.text(at[0], at[1], text, ha="center", va="center", fontsize=7, color="white" if light else "black")
        drawn = place.imshow(margins, origin="lower", aspect="auto", cmap="viridis", vmin=0, vmax=most)
        place.set_xticks(range(len(ticks[0])), list(ticks[0].values()))
        place.set_yticks(range(len(ticks[1])), list(ticks[1].values()))
        place.set_title(label, fontsize=8, loc="left")
    for place in axes.flat[len(panels) :]:
        place.set_visible(False)
    assert drawn is not None  # there is a job that is done
    figure.supxlabel(_name(across), fontsize=9)
    figure.supylabel(_name(up), fontsize=9)
    figure.colorbar(drawn, ax=axes, label=r"certified margin $\lambda$ (1/s)")
    return figure


def _ticks(column: pl.Series) -> dict[float, str]:
    """Numbers in order, with what stands at them."""
    numbers = _values(column)
    assert numbers is not None
    texts = dict(sorted(zip(numbers, map(str, column), strict=True)))
    return {number: text if text.startswith("[") else f"{number:.3g}" for number, text in texts.items()}


def _lines(done: pl.DataFrame, axis: str, others: list[str]) -> Figure:
    """A line for each choice of the others; jobs that prove nothing have an open mark at 0."""
    figure = Figure(figsize=(5.2, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    numbers = _values(done[axis])
    assert numbers is not None
    if numeric := not any("[" in str(value) for value in done[axis]):
        if min(numbers) > 0 and max(numbers) / min(numbers) >= 10:
            axes.set_xscale("log")
            ticks = sorted(set(numbers)) if len(set(numbers)) <= 10 else []
            axes.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
            axes.minorticks_off()
    else:
        texts = _ticks(done[axis])
        axes.set_xticks(range(len(texts)), list(texts.values()))
    places = {number: number if numeric else place for place, number in enumerate(sorted(set(numbers)))}
    groups: dict[str, list[tuple[float, float, float]]] = {}
    for number, row in zip(numbers, done.iter_rows(named=True), strict=True):
        label = ", ".join(_choice(c.removeprefix(SWEPT), str(row[c])) for c in others)
        figures = [math.nan if row[key] is None else row[key] for key in ("certified", "falsified")]
        groups.setdefault(label, []).append((places[number], figures[0], figures[1]))
    for index, (label, found) in enumerate(sorted(groups.items())):
        points = np.array(sorted(found))
        colour = SERIES_COLOURS[index % len(SERIES_COLOURS)]
        style = ("-", "--", ":", "-.")[index // len(SERIES_COLOURS) % 4]
        proven = np.isfinite(points[:, 1])
        axes.plot(points[:, 0], points[:, 1], f"o{style}", color=colour, ms=4, lw=1.2, label=label or None)
        missing = points[~proven, 0]
        axes.plot(missing, np.zeros_like(missing), "o", mfc="white", color=colour, ms=5, clip_on=False, zorder=3)
    axes.set_ylim(bottom=0)
    axes.set_xlabel(_name(axis))
    axes.set_ylabel(r"certified margin $\lambda$ (1/s)")
    axes.grid(color="#e9ecef", lw=0.6)
    axes.set_axisbelow(True)
    if any(groups):
        axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _name(column: str) -> str:
    key = column.removeprefix(SWEPT)
    return LABELS.get(key, key)


def _choice(key: str, value: str) -> str:
    """One of the other choices, for the legend: a number or an interval says what it is of, a name by itself."""
    if not _is_number(value):
        return value
    return f"{LABELS.get(key, key)} {value if value.startswith('[') else format(float(value), '.4g')}"


def _is_number(text: str) -> bool:
    try:
        _value(text)
    except ValueError:
        return False
    return True


def _values(column: pl.Series) -> list[float] | None:
    """Numbers to put on an axis: of an interval its width. None where one of them is neither."""
    try:
        return [_value(str(value)) for value in column]
    except ValueError:
        return None


def _value(text: str) -> float:
    if text.startswith("["):
        lower, upper = text.strip("[]").split(",")
        return float(upper) - float(lower)
    return float(text)
