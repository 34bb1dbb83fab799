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
# # Reading and checking a certificate
#
# A certificate is a JSON file of rational numbers. Whoever reads it needs no trust in who wrote it: no solver, no
# learner, no floating-point number takes part in the verdict. We open one, check one of its claims by hand, let the
# checker do the rest, and then forge a digit.

# %%
# %matplotlib inline
import copy
from fractions import Fraction

import matplotlib
import numpy as np
from IPython.display import display
from matplotlib.figure import Figure

import cfjax
from cfjax.check import check_document, check_file
from cfjax.report.style import EDGE_COLOUR, FUNNEL_COLOUR, GOAL_COLOUR, INLET_COLOUR, STYLE, ellipse_outline
from cfjax.tubes import chain_document, library_files, read_tube


matplotlib.rcParams.update(STYLE)

# %% [markdown]
# There is no switch in this notebook: it is small enough as it is.
#
# ## One that travels with the package
#
# The library's tubes are certificates, packed. Each is proven for every path within its bounds.

# %%
files = {file.name.split(".")[0]: file for file in library_files()}
file = files["normal-tight-slow"]
print(", ".join(files))

# %% [markdown]
# What it proves, says the checker, after it has gone through all of it:

# %%
report = check_file(file)
print(report.text)
assert report.outcome.value == 0

# %% [markdown]
# ## A claim checked by hand
#
# Claim (a): I lies in the tube. I is a ball of radius r, the tube is xᵀCx ≤ 1: so 1/r² − C has to be positive
# definite. Fractions and elimination are enough: all pivots positive. Claim (b), the tube inside G, is the same the
# other way round.

# %%
tube = read_tube(file)
matrix = [[Fraction(int(entry.p), int(entry.q)) for entry in row] for row in tube.shape]


def pivots(rows: list[list[Fraction]]) -> list[Fraction]:
    """Of Gaussian elimination, exactly: all positive for a positive definite matrix, and only then."""
    rows = copy.deepcopy(rows)
    for k in range(len(rows)):
        for i in range(k + 1, len(rows)):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [rows[k][k] for k in range(len(rows))]


inlet, goal = Fraction("0.15"), Fraction("0.25")
inside = pivots([[(i == j) / inlet**2 - c for j, c in enumerate(row)] for i, row in enumerate(matrix)])
outside = pivots([[c - (i == j) / goal**2 for j, c in enumerate(row)] for i, row in enumerate(matrix)])
print("(a)", [f"{float(pivot):.3g}" for pivot in inside])
print("(b)", [f"{float(pivot):.3g}" for pivot in outside])
assert min(inside) > 0 and min(outside) > 0

# %%
shape = np.array([[float(entry) for entry in row] for row in matrix])
inverse = np.linalg.inv(shape)
figure = Figure(figsize=(7, 3), layout="constrained")
for axes, (i, j), labels in zip(
    figure.subplots(1, 2), ((1, 2), (1, 0)), (("x (m)", "y (m)"), ("x (m)", "heading (rad)")), strict=True
):
    axes.fill(*ellipse_outline(inverse[np.ix_([i, j], [i, j])]), facecolor=FUNNEL_COLOUR, edgecolor=EDGE_COLOUR)
    for radius, colour in ((inlet, INLET_COLOUR), (goal, GOAL_COLOUR)):
        axes.plot(*ellipse_outline(float(radius) ** 2 * np.eye(2)), color=colour)
    axes.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")
display(figure)

# %% [markdown]
# Turquoise I, blue the tube, violet G: shadows on two planes. Claim (d), that V can always be made to fall, has sums of
# squares: matrices again, each shown to be positive definite in the same way.
#
# ## A path's own certificate
#
# `follow` proves that a path keeps a tube's bounds; its document carries the path as polynomials and the tubes whole.

# %%
found = cfjax.follow(cfjax.oval(speed=1.0), closed=True)
document = chain_document(found)
for name, part in document.items():
    size = f"{len(part)} entries" if isinstance(part, list | dict) else part
    print(f"{name:10} {str(size)[:80]}")
print(check_document(document).text)

# %% [markdown]
# ## A forged digit
#
# Somebody makes the oval a little faster in the file. First the hash betrays it. Without the hash (`--skip-hash`) the
# replay does: speeds of neighbouring pieces no longer meet.

# %%
forged = copy.deepcopy(document)
piece = forged["problem"]["path"]["pieces"][0]
print("speed of the first piece:", piece["speed"])
piece["speed"][0] = "5/4"
for skip in (False, True):
    answer = check_document(forged, skip_hash=skip)
    print(f"skip_hash={skip}: {answer.outcome.name}: {answer.message[:200]}")
    assert answer.outcome.value != 0

# %% [markdown]
# `docs/certificate-format.md` says what each field means and what has to be shown, so that somebody else can write a
# checker.
