"""What all pictures share: colours, type, and a few shapes."""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from cfjax.funnel import Funnel
from cfjax.report.rounded import rounded_up, written


if TYPE_CHECKING:
    from matplotlib.axes import Axes

FUNNEL_COLOUR, EDGE_COLOUR = "#cfe3f5", "#4c86b8"
INLET_COLOUR, GOAL_COLOUR, REFERENCE_COLOUR = "#2b8a3e", "#c92a2a", "#111111"
BODY_COLOUR, BODY_EDGE_COLOUR, OBSTACLE_COLOUR = "#eceff2", "#adb5bd", "#343a40"
SPEED_COLOUR, FAILED_COLOUR = "#0b7285", "#e03131"
ASKED = (0, (1, 1.2))  # line style of the sets that were asked for, I and G, beside those of the funnel
START, END, INLET, GOAL = "funnel's start", "funnel's end", "initial set I", "goal set G"
CAR_COLOURS = ("#e8590c", "#9c36b5", "#0b7285", "#5c940d", "#a61e4d", "#364fc7")
STYLE: dict[Any, Any] = {
    "font.family": "serif",
    "mathtext.fontset": "cm",
    "font.size": 9,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}


def rotation(alpha: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 2 2"]:
    """Rotations from the reference's frame to the plane, one per heading (rad)."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def ellipse_outline(inverse: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "2 96"]:
    """Points of {z : zᵀ inverse⁻¹ z = 1}."""
    angle = np.linspace(0, 2 * np.pi, 96)
    return np.linalg.cholesky(inverse) @ np.stack([np.cos(angle), np.sin(angle)])


def draw_shell(axes: "Axes", funnel: Funnel) -> None:
    """The levels of V between which it decreases with the proven margin."""
    axes.axhline(1.0, color=EDGE_COLOUR, lw=1.0)
    axes.axhspan(funnel.beta_lower, 1.0, color=FUNNEL_COLOUR, lw=0, zorder=0)
    axes.annotate(
        rf"shell $V \in [{rounded_up(written(funnel.beta_lower))}, 1]$: $\dot V \leq -\lambda$",
        (0.98, funnel.beta_lower),
        xycoords=("axes fraction", "data"),
        xytext=(0, -3),  # below the shell, which is narrower than a line of text in a low panel
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=8,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )
