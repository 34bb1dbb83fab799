"""Certified margins against what a sweep varied: one line for each combination of the other choices."""

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from cfjax.report.style import CAR_COLOURS, STYLE
from cfjax.report.table import SWEPT


PICTURE = "margin.png"
LABELS = {
    "path.speed": "speed (m/s)",
    "beta_lower": r"lower level of the shell $\beta$",
    "timing": r"interval of $u_0$",
}


def save_sweep_picture(table: pl.DataFrame, output: Path) -> Path | None:
    """Draw margin.png; None where nothing was varied but names, or no job has a verdict.

    The axis is the swept key with the most numeric values; jobs that prove nothing have an open mark at 0.
    """
    done = table.filter(pl.col("certified").is_not_null() | pl.col("falsified").is_not_null())
    swept = [column for column in table.columns if column.startswith(SWEPT)]
    axes_of = [column for column in swept if not done[column].is_null().any() and _values(done[column]) is not None]
    if done.is_empty() or not axes_of:
        return None
    axis = max(axes_of, key=lambda column: done[column].n_unique())
    others = [c for c in swept if c != axis and table[c].n_unique() > 1]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.2, 3.4), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        name = axis.removeprefix(SWEPT)
        numbers = _values(done[axis])
        assert numbers is not None
        if numeric := not any("[" in str(value) for value in done[axis]):
            if min(numbers) > 0 and max(numbers) / min(numbers) >= 10:
                axes.set_xscale("log")
                ticks = sorted(set(numbers)) if len(set(numbers)) <= 10 else []
                axes.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
                axes.minorticks_off()
        else:
            widest = sorted(dict(zip(numbers, map(str, done[axis]), strict=True)).items())
            axes.set_xticks(range(len(widest)), [text for _, text in widest])
        places = {number: number if numeric else place for place, number in enumerate(sorted(set(numbers)))}
        groups: dict[str, list[tuple[float, float, float]]] = {}
        for number, row in zip(numbers, done.iter_rows(named=True), strict=True):
            label = ", ".join(_choice(c.removeprefix(SWEPT), str(row[c])) for c in others)
            figures = [math.nan if row[key] is None else row[key] for key in ("certified", "falsified")]
            groups.setdefault(label, []).append((places[number], figures[0], figures[1]))
        for index, (label, found) in enumerate(sorted(groups.items())):
            points = np.array(sorted(found))
            colour = CAR_COLOURS[index % len(CAR_COLOURS)]
            style = ("-", "--", ":", "-.")[index // len(CAR_COLOURS) % 4]
            proven = np.isfinite(points[:, 1])
            axes.plot(points[:, 0], points[:, 1], f"o{style}", color=colour, ms=4, lw=1.2, label=label or None)
            missing = points[~proven, 0]
            axes.plot(missing, np.zeros_like(missing), "o", mfc="white", color=colour, ms=5, clip_on=False, zorder=3)
        axes.set_ylim(bottom=0)
        axes.set_xlabel(LABELS.get(name, name))
        axes.set_ylabel(r"certified margin $\lambda$ (1/s)")
        axes.grid(color="#e9ecef", lw=0.6)
        axes.set_axisbelow(True)
        if any(groups):
            axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
        notes = ["open marks: nothing proven"] if table["certified"].is_null().any() else []
        if waiting := table.height - done.height:
            notes.append(f"{waiting} jobs without a verdict are left out")
        if notes:
            axes.set_title("; ".join(notes), fontsize=8, color="#495057", loc="left")
        draft = output / f".part-{PICTURE}"
        figure.savefig(draft, dpi=200)
    draft.replace(output / PICTURE)
    return output / PICTURE


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
