"""What all pictures share: colours, type, and a few shapes.

Colours that stand in one picture are told apart by colour-blind readers too.
"""

from typing import Any

import numpy as np
from cycler import cycler
from jaxtyping import Float


FUNNEL_COLOUR, EDGE_COLOUR = "#cfe3f5", "#4c86b8"
INLET_COLOUR, GOAL_COLOUR, REFERENCE_COLOUR = "#22bba5", "#6e3980", "#111111"
BODY_COLOUR, BODY_EDGE_COLOUR, OBSTACLE_COLOUR = "#eceff2", "#adb5bd", "#343a40"
CAR_COLOUR, FAILED_COLOUR = "#e87a00", "#b2000f"
SERIES_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")  # of curves that have no other
STYLE: dict[Any, Any] = {
    "font.family": "serif",
    "mathtext.fontset": "cm",
    "font.size": 9,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "axes.prop_cycle": cycler(color=SERIES_COLOURS),
    "svg.hashsalt": "cfjax",  # the same picture is the same file
    "pdf.fonttype": 42,  # publishers refuse the other one
}
PAPER: dict[Any, Any] = {  # pictures that are as wide as a column or page: letters as in the text around them
    **STYLE,
    "font.size": 8,
    "font.family": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
}
WIDTHS = {"column": 8.8, "page": 18.1}  # cm, of a journal in two columns


def rotation(alpha: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t 2 2"]:
    """Rotations from the reference's frame to the plane, one per heading (rad)."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def ellipse_outline(inverse: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "2 96"]:
    """Points of {z : zᵀ inverse⁻¹ z = 1}."""
    angle = np.linspace(0, 2 * np.pi, 96)
    return np.linalg.cholesky(inverse) @ np.stack([np.cos(angle), np.sin(angle)])
