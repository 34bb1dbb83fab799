"""What pictures show, as data: panels of marks, each of a kind that has one name, colour and line wherever it is drawn.

`draw.py` renders panels with Matplotlib, `page/figure.py` with plotly.js; neither knows what the marks stand for.
Labels are plain text with the letters of the mathematics, which both of them write.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from jaxtyping import Float

from cfjax import coerce
from cfjax.report.style import (
    BODY_COLOUR,
    BODY_EDGE_COLOUR,
    CAR_COLOUR,
    EDGE_COLOUR,
    FAILED_COLOUR,
    FUNNEL_COLOUR,
    GOAL_COLOUR,
    INLET_COLOUR,
    OBSTACLE_COLOUR,
    REFERENCE_COLOUR,
)


@dataclass(frozen=True)
class Kind:
    """What a mark stands for: its name in the legend, which is empty for what has no entry, and how it looks."""

    label: str
    colour: str  # of lines and symbols
    width: float = 1.0  # of lines, pt in print
    dash: Literal["solid", "dash", "dot"] = "solid"
    fill: str = ""  # colour of the area within the lines
    symbol: Literal["", "dot", "cross", "diamond"] = ""  # at each point, instead of lines
    opacity: float = 1.0  # of lines through points; of a band its area


FUNNEL = Kind("funnel", EDGE_COLOUR, fill=FUNNEL_COLOUR)
TUBE = replace(FUNNEL, label="tube")
BODY = Kind("reach of the body", BODY_EDGE_COLOUR, 0.8, fill=BODY_COLOUR)
WALL = Kind("wall", OBSTACLE_COLOUR, 1.2)
CLOSEST = Kind("least room", GOAL_COLOUR, 2.0)
OBSTACLE = Kind("obstacle", OBSTACLE_COLOUR, 0.0, fill=OBSTACLE_COLOUR)
REFERENCE = Kind("reference", REFERENCE_COLOUR, 0.9, "dash")
ONE_PATH = replace(REFERENCE, label="one of the paths")
CARS = Kind("cars", CAR_COLOUR, 0.6, opacity=0.8)
CAR_STARTS = Kind("", CAR_COLOUR, symbol="dot")
START, END = Kind("funnel's start", INLET_COLOUR, 1.4), Kind("funnel's end", GOAL_COLOUR, 1.4)
LATER_START, EARLIER_END = replace(START, label="", width=0.8), replace(END, label="", width=0.8)
INLET, GOAL = Kind("initial set I", INLET_COLOUR, 1.2, "dot"), Kind("goal set G", GOAL_COLOUR, 1.2, "dot")
FAILED = Kind("here the proof failed", FAILED_COLOUR, 3.0)
FAILED_AT = Kind("", FAILED_COLOUR, symbol="cross")
FAILED_SPAN = Kind("", FAILED_COLOUR, 0.8, fill=FAILED_COLOUR, opacity=0.15)
WORST = Kind("worst point of (d)", FAILED_COLOUR, symbol="diamond")
NEAREST = Kind("closest approach", CAR_COLOUR, symbol="diamond")
SHELL = Kind("", EDGE_COLOUR, fill=FUNNEL_COLOUR)
JOINT = Kind("", "#adb5bd", 0.6)
PROFILE = Kind("", REFERENCE_COLOUR)
ZERO = replace(PROFILE, width=0.6, dash="dash")
CERTIFIED = Kind("certified margin", EDGE_COLOUR, 1.2, fill=FUNNEL_COLOUR)
FALSIFIED = Kind("falsified margin", REFERENCE_COLOUR, 0.9, "dash")
BEYOND = replace(FAILED_SPAN, dash="dot")

Points = Float[np.ndarray, "_ 2"]  # of any number: parts differ in length


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines through points; of a kind with a fill areas, whose holes turn the other way round than their outlines."""

    kind: Kind
    parts: Sequence[Points]
    theta: Sequence[Float[np.ndarray, " _"]] = ()  # of the points of each part, s: on the plane, its height in space
    each: str = ""  # what a part is called, numbered from 1, for who points at it


@dataclass(frozen=True)
class Band:
    """All between two heights of a panel, with a line at either; an infinite one is the panel's end and has no line."""

    kind: Kind
    low: float
    high: float
    upright: bool = False  # between two places across instead


@dataclass(frozen=True)
class Note:
    """Text at the right end of a panel, below a height."""

    text: str
    at: float


@dataclass(frozen=True)
class Axis:
    """What it counts, with the unit, and from where to where."""

    title: str
    range: tuple[float, float] | None = None  # None: as far as the marks reach
    text: Callable[[float], str] | None = None  # how a number of it is rounded where people read it


@dataclass(frozen=True)
class Panel:
    """Marks over two axes, the rearmost first; lines of which there is none are left out."""

    name: str
    across: Axis
    up: Axis
    marks: tuple[Lines | Band | Note, ...]
    equal: bool = False  # a unit is as long across as upwards: a map

    def __post_init__(self) -> None:
        coerce.keep(self, marks=tuple(mark for mark in self.marks if not isinstance(mark, Lines) or mark.parts))

    @property
    def shape(self) -> float | None:
        """Width over height of a map with ends; None of other panels."""
        if not self.equal or self.across.range is None or self.up.range is None:
            return None
        return float(np.ptp(self.across.range) / np.ptp(self.up.range))

    def ends(self, band: Band) -> tuple[float, float]:
        """From where to where a band reaches in this panel."""
        axis = self.across if band.upright else self.up
        low, high = axis.range or (-math.inf, math.inf)
        return max(band.low, low), min(band.high, high)


def rings_of(region: shapely.Geometry) -> list[Points]:
    """Outlines and holes of a region, as an area of `Lines` has them."""
    parts = shapely.get_parts(shapely.orient_polygons(region))
    polygons = [part for part in parts if isinstance(part, shapely.Polygon) and not part.is_empty]
    return [np.asarray(ring.coords) for part in polygons for ring in (part.exterior, *part.interiors)]


def joined(parts: Sequence[Float[np.ndarray, "_ ..."]]) -> Float[np.ndarray, "_ ..."]:
    """Parts one after another with a gap of NaN between them."""
    gap = np.full((1, *parts[0].shape[1:]), np.nan)
    return np.concatenate([each for part in parts for each in (part, gap)][:-1])
