# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # The paper's table
#
# The paper asks for funnels on straight lines, circles, an oval and past an obstacle: with path following (PF) and
# with trajectory tracking (TT). It found some and did not find others. Here are its rows again, with its own function
# V = xᵀCx + c₀θ and with V = e^(kθ) xᵀCx, and with one difference: what is found is proven.

# %%
# %matplotlib inline
import os

import matplotlib
import numpy as np
import polars
from IPython.display import display
from matplotlib.figure import Figure

from cfjax.report.style import SERIES_COLOURS, STYLE
from cfjax.rounded import margin_text
from experiments.paper_table import cases, run


matplotlib.rcParams.update(STYLE)
_ = polars.Config.set_tbl_rows(40).set_tbl_hide_dataframe_shape(True).set_tbl_hide_column_data_types(True)

# %% [markdown]
# The one switch. With `CI` in the environment: the straight line with the paper's V only, PF and TT, and 500 cars.
# Else all 36 lines and 10,000 cars, which takes a while: the table of `docs/results.md`.

# %%
quick = bool(os.environ.get("CI"))
wanted = [case for case in cases() if not quick or case[:2] == ("straight", "paper")]
lines = [run(*case, "gradient", 500 if quick else 10_000, ["robustness=false"]) for case in wanted]

# %% [markdown]
# *falsified* is the smallest margin that the falsifier could find, *certified* the one that is proven, both in 1/s.
# *paper* is what the paper reports; that it did not find a funnel was never a proof that there is none.

# %%
columns = ("row", "template", "method", "verdict", "falsified", "certified", "cars_lost", "paper")
rows = [{name: getattr(line, name) for name in columns} for line in lines]
shown = {name: [margin_text(row[name]) for row in rows] for name in ("falsified", "certified")}
display(polars.DataFrame(rows).with_columns(**{name: polars.Series(texts) for name, texts in shown.items()}))

# %%
rows = list(dict.fromkeys((line.row, line.template) for line in lines))
figure = Figure(figsize=(8, 1.2 + 0.32 * len(rows)), layout="constrained")
axes = figure.subplots()
for offset, method, colour in ((-0.18, "pf", SERIES_COLOURS[0]), (0.18, "tt", SERIES_COLOURS[5])):
    margins = {(line.row, line.template): line.certified or 0.0 for line in lines if line.method == method}
    places = np.arange(len(rows)) + offset
    axes.barh(places, [margins[row] for row in rows], 0.34, color=colour, label=method.upper())
axes.set_yticks(range(len(rows)), [f"{row}, {template} V" for row, template in rows])
axes.invert_yaxis()
axes.set_xlabel("proven margin λ (1/s)")
axes.legend()
display(figure)

# %% [markdown]
# Path following is ahead on every row: that the reference can wait is worth something. And on the rows on which the
# paper found nothing for tracking there is a funnel, a thin one: λ is small, and shell and timing, of which the paper
# gives no numbers, decide.

# %%
margin = {(line.row, line.template, line.method): line.certified for line in lines}
for row, template in rows:
    pf, tt = (margin[row, template, method] for method in ("pf", "tt"))
    assert pf is not None, f"{row}, {template}: no funnel for path following"
    print(f"{row}, {template} V: PF {margin_text(pf)}, TT {'nothing' if tt is None else margin_text(tt)}")
    assert tt is None or pf > tt
assert all(line.cars_lost == 0 for line in lines if line.certified)
