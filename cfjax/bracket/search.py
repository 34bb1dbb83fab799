"""The search for a proof that no funnel of the paper's form has a margin: branch and bound over its five unknowns.

What is shown, and why it suffices, says `cfcheck.margin.upper_bound`. Here boxes are cut until weights are found for
which a leaf holds. They solve a small linear program: the weighted sum in the middle of the box, less what its
derivatives, as intervals, can take away from there, is made as large as possible.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from flint import fmpq
from jaxtyping import Float
from scipy.optimize import linprog

from cfcheck.claims.problem import read_problem
from cfcheck.claims.proof import dynamics_of
from cfcheck.exact.rational import rational
from cfcheck.margin.upper_bound import (
    UNKNOWNS,
    Box,
    Cut,
    Empty,
    Leaf,
    Place,
    Row,
    Term,
    Tree,
    halves,
    leaf_holds,
)
from cfcheck.margin.upper_bound_file import write_upper_bound
from cfcheck.reader import Broken
from cfjax.bracket.interval import Interval, Lift, unknowns
from cfjax.certificate.trace import trace_deviation
from cfjax.certificate.writing import write_problem
from cfjax.coerce import instance, number, whole
from cfjax.errors import InputError
from cfjax.problem import Problem


DIRECTIONS = 48  # places on each level and end of the path
MOST_IN_PROGRAM = 40  # places that a linear program weighs
WEIGHT = 2**12  # what the weights of a leaf's places sum up to, nearly
MOST_WEIGHT = 64  # of a condition, in the linear program, where those of all places sum up to one
TOGETHER = 32  # boxes that are looked at in one go
NEAR, AROUND = 16, 0.3
CURVES = 1e-3  # the least that an unknown counts for when a box is cut
MOST_BOXES = 40_000


@dataclass(frozen=True)
class Bound:
    """No funnel of the form has margin `margin` (1/s) or more; the file that proves it, and how large its tree is."""

    margin: float
    document: dict[str, Any]
    leaves: int


def upper_bound(
    problem: Problem, margin: float, *, beta_lower: float = 0.9, most_boxes: int = MOST_BOXES
) -> Bound | None:
    """A proof that no V = xᵀ C x + c0 θ has margin λ ≥ `margin` (1/s), for C that couple α with x and y with v alone.

    Conditions (a), (b) and (d) on the shell β̲ ≤ V ≤ 1 are used, on a straight line at one speed. None where no proof is
    found with so many boxes: there may be such a funnel, or the boxes do not suffice.

    Raises:
        InputError: a problem of another kind.
    """
    instance("problem", problem, Problem)
    margin = number("margin", margin, "1/s", above=0)
    beta_lower, most_boxes = number("beta_lower", beta_lower, above=0, below=1), whole("most_boxes", most_boxes, 1)
    question = write_problem(problem, trace_deviation(problem.vehicle))
    claim = read_problem(question)
    try:
        row = Row(claim, dynamics_of(claim.car), rational(beta_lower))
    except Broken as error:
        raise InputError(str(error)) from None
    search = _Search(row, rational(margin))
    tree = search.tree(most_boxes)
    if tree is None:
        return None
    document = write_upper_bound(question, row.beta_lower, search.margin, search.written, tree)
    return Bound(float(search.margin), document, search.leaves)


class _Node:
    """A box of the tree: a leaf, two halves, or not looked at yet."""

    def __init__(self, box: Box) -> None:
        self.box = box
        self.leaf: Leaf | Empty | None = None
        self.axis = 0
        self.parts: tuple[_Node, ...] = ()

    def cut(self, axis: int) -> "tuple[_Node, ...]":
        self.axis, self.parts = axis, tuple(_Node(part) for part in halves(self.box, axis))
        return self.parts

    @property
    def tree(self) -> Tree:
        return self.leaf or Cut(self.axis, self.parts[0].tree, self.parts[1].tree)


class _Search:
    """Boxes cut until each of them is shown to hold no candidate."""

    def __init__(self, row: Row, margin: fmpq) -> None:
        self.row, self.margin = row, margin
        self.leaves = 0
        self.places, self.written = _places(row)
        self.is_free = row.timing[0] < row.timing[1]
        self.ends = (0, 1) if self.is_free else (0,)  # of u0
        moving = [place for place in self.places if place.direction is not None]
        still = [place for place in self.places if place.direction is None]
        self.kinds = [_together(moving), *([_together(still)] if self.is_free else [])]

    def tree(self, most_boxes: int) -> Tree | None:
        """None where so many boxes do not suffice."""
        root = _Node(self.row.root)
        waiting = [root]
        while waiting:
            nodes, waiting = waiting[-TOGETHER:], waiting[:-TOGETHER]
            most_boxes -= len(nodes)
            if most_boxes < 0:
                return None
            for node, offer in zip(nodes, self._offers([node.box for node in nodes]), strict=True):
                node.leaf, axis = self._leaf(node.box, offer)
                self.leaves += node.leaf is not None
                waiting += () if node.leaf else node.cut(axis)
        return root.tree

    def _leaf(self, box: Box, offer: "_Offer") -> tuple[Leaf | Empty | None, int]:
        """Weights that close the box, if any do; and the unknown at which it is cut otherwise."""
        for block in (0, 1):
            if self.row.is_empty(box, block):
                return Empty(block), 0
        weights, unsure = offer.alone, np.zeros(0)
        if weights is None:
            weights, unsure = offer.weights()
        if weights is not None:
            leaf = offer.leaf(weights)
            if leaf_holds(self.row, self.margin, self.places, leaf, box):
                return leaf, 0
        if not unsure.size:
            _, unsure = offer.weights()
        return None, int((offer.half * (unsure + CURVES)).argmax())

    def _offers(self, boxes: Sequence[Box]) -> "list[_Offer]":
        """What can be weighed in each box: V̇ + λ at places where the better end of u0 is clear, and conditions."""
        ends = np.array([[[float(low), float(high)] for low, high in box] for box in boxes])
        half = (ends[..., 1] - ends[..., 0]) / 2
        low, high = (np.concatenate([ends.mean(axis=2), ends[..., k]]) for k in (0, 1))
        candidate, lift = unknowns(low, high), Lift(UNKNOWNS)
        with np.errstate(all="ignore"):
            rates = [
                [_terms(self.row.value_rate(kind, end, candidate, lift), len(boxes)) for end in self.ends]
                for kind in self.kinds
            ]
            conditions = _joined([_terms(one, len(boxes)) for one in self.row.conditions(candidate, lift)])
        return [self._offer(box, half[box], rates, conditions) for box in range(len(boxes))]

    def _offer(self, box: int, half: np.ndarray, rates: Sequence[Sequence["_Terms"]], conditions: "_Terms") -> "_Offer":
        parts, numbers, first = [], [], 0
        for kind, by_end in zip(self.kinds, rates, strict=True):
            ends = [terms.of_box(box) for terms in by_end]
            best, worst = ends[0], ends[-1]
            chosen = best.value > worst.value
            best, worst = _where(chosen, worst, best), _where(chosen, best, worst)
            clear = np.isfinite(best.value) & np.isfinite(best.width).all(axis=0)
            if self.is_free and kind.direction is not None:
                gain = _Terms(
                    worst.value - best.value,
                    worst.slope - best.slope,
                    worst.width + best.width,
                    worst.low - best.high,
                    worst.high - best.low,
                )
                clear &= gain.least(half) > 0
            found = np.flatnonzero(clear)
            parts.append(best.chosen(found))
            numbers += [(first + int(k), int(chosen[k])) for k in found]
            first += len(chosen)
        every = _joined(parts)
        likely = np.argsort(-(every.value - half @ every.width))[:MOST_IN_PROGRAM]
        wanted_terms = conditions.of_box(box).negated()
        known = np.flatnonzero(np.isfinite(wanted_terms.value) & np.isfinite(wanted_terms.width).all(axis=0))
        terms = _joined([every.chosen(likely).raised(float(self.margin)), wanted_terms.chosen(known)])
        return _Offer(half, terms, [numbers[k] for k in likely], known.tolist())


@dataclass(frozen=True)
class _Terms:
    """Numbers that may be weighed, of one box or of several: value in the middle, derivatives as middle and half-width.

    Unknowns are the first axis of derivatives, numbers the last one.
    """

    value: np.ndarray
    slope: np.ndarray
    width: np.ndarray
    low: np.ndarray  # as intervals have it
    high: np.ndarray

    def of_box(self, box: int) -> "_Terms":
        return _Terms(self.value[box], self.slope[:, box], self.width[:, box], self.low[box], self.high[box])

    def negated(self) -> "_Terms":
        return _Terms(-self.value, -self.slope, self.width, -self.high, -self.low)

    def raised(self, by: float) -> "_Terms":
        return replace(self, value=self.value + by, low=self.low + by, high=self.high + by)

    def chosen(self, index: np.ndarray) -> "_Terms":
        return _Terms(*(field[..., index] for field in _fields(self)))

    def least(self, half: Float[np.ndarray, " u"]) -> Float[np.ndarray, " k"]:
        """In the box."""
        return np.fmax(self.value - half @ (abs(self.slope) + self.width), self.low)


def _terms(found: Interval, boxes: int) -> _Terms:
    """Of an interval for the middles of the boxes, then for the boxes themselves."""
    low, high = (np.broadcast_to(part, (UNKNOWNS, *found.value[0].shape))[:, boxes:] for part in found.slopes)
    (middle, *_), (least, most) = (part[:boxes] for part in found.value), (part[boxes:] for part in found.value)
    return _Terms(middle, (low + high) / 2, (high - low) / 2, least, most)


def _joined(parts: Sequence[_Terms]) -> _Terms:
    return _Terms(*(np.concatenate(each, axis=-1) for each in zip(*map(_fields, parts), strict=True)))


def _where(chosen: np.ndarray, one: _Terms, other: _Terms) -> _Terms:
    return _Terms(*(np.where(chosen, a, b) for a, b in zip(_fields(one), _fields(other), strict=True)))


def _fields(terms: _Terms) -> tuple[np.ndarray, ...]:
    return terms.value, terms.slope, terms.width, terms.low, terms.high


@dataclass(frozen=True)
class _Offer:
    """What can be weighed in one box: places by their number and end of u0, then the conditions."""

    half: Float[np.ndarray, " u"]
    terms: _Terms
    places: list[tuple[int, int]]
    conditions: list[int]

    @property
    def alone(self) -> Float[np.ndarray, " k"] | None:
        """All weight on one of them, where that is enough."""
        least = self.terms.least(self.half)
        best = int(least.argmax())
        return np.eye(least.size)[best] if least[best] > 0 else None

    def weights(self) -> tuple[Float[np.ndarray, " k"] | None, Float[np.ndarray, " u"]]:
        """With a sum above zero, if there are some; and how unsure each unknown leaves the sum."""
        terms, size = self.terms, len(self.half)
        count = terms.value.size
        cost = -np.concatenate([terms.value - self.half @ terms.width, -self.half])
        slopes = np.block([[terms.slope, -np.eye(size)], [-terms.slope, -np.eye(size)]])
        places = np.arange(count + size) < len(self.places)
        most = [(0, MOST_WEIGHT)] * count + [(0, None)] * size
        found = linprog(cost, slopes, np.zeros(2 * size), places[None].astype(float), [1.0], most, method="highs")
        if found.status != 0:
            return None, np.abs(terms.slope).max(axis=1)
        weights = found.x[:count]
        near = slice(0, min(NEAR, len(self.places)))
        around = (abs(terms.slope[:, near]) + terms.width[:, near]).mean(axis=1)
        unsure = terms.width @ weights + found.x[count:]
        return weights if found.fun < 0 else None, unsure + AROUND * around

    def leaf(self, weights: Float[np.ndarray, " k"]) -> Leaf:
        """The weights as whole numbers."""
        whole = np.rint(weights * WEIGHT).astype(int)
        places = len(self.places)
        return Leaf(
            tuple(Term(*self.places[k], int(whole[k])) for k in range(places) if whole[k]),
            tuple((k, int(weight)) for k, weight in zip(self.conditions, whole[places:], strict=True) if weight),
        )


def _places(row: Row) -> tuple[list[Place], list[dict[str, Any]]]:
    """All places, as the checker has them and as they are written."""
    places, written = [], []
    ends = tuple(itertools.product((("inner", row.beta_lower), ("outer", fmpq(1))), ((0, fmpq(0)), (1, row.duration))))
    for k in range(DIRECTIONS):
        point = _on_circle(2 * np.pi * k / DIRECTIONS)
        for (level, height), (end, theta) in ends:
            places.append(Place(height, theta, point))
            written.append({"level": level, "end": end, "direction": [str(part) for part in point]})
    for sign, side in ((1, "right"), (-1, "left")):
        for (level, height), (end, theta) in ends:
            places.append(Place(height, theta, None, sign))
            written.append({"level": level, "end": end, "direction": {"still": side}})
    return places, written


def _on_circle(angle: float) -> tuple[fmpq, fmpq]:
    """A rational point of the unit circle near this angle (rad); the axes are met."""
    if abs(angle - np.pi) < 1e-9:
        return fmpq(-1), fmpq(0)
    t = rational(round(float(np.tan(angle / 2)), 4))
    return (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)


def _together(places: Sequence[Place]) -> Place:
    """Many places of one kind as one, with arrays for numbers."""

    def array(values: Sequence[Any]) -> np.ndarray:
        return np.array([float(value) for value in values])

    pairs = [place.direction for place in places if place.direction]
    directions = (array([cos for cos, _ in pairs]), array([sin for _, sin in pairs])) if pairs else None
    return Place(
        array([place.level for place in places]),
        array([place.theta for place in places]),
        directions,
        array([place.sign for place in places]),
    )
