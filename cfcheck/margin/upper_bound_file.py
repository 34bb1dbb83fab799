"""The file of an upper bound: the question, places of the ridge, and the tree, read with sizes checked, and written."""

from collections.abc import Mapping, Sequence
from typing import Any

from flint import fmpq

from cfcheck.claims.document import document_hash
from cfcheck.claims.problem import problem_of
from cfcheck.claims.proof import dynamics_of
from cfcheck.exact.enclosure import Budget
from cfcheck.margin.upper_bound import CONDITIONS, UNKNOWNS, Cut, Empty, Leaf, Place, Row, Term, Tree, UpperBound
from cfcheck.reader import Item


FORMAT, VERSION = "cfjax-upper-bound", 1
MOST_PLACES, MOST_DEPTH, MOST_IN_LEAF = 1024, 96, 32
MOST_TERMS = 200_000  # of a tree, where a leaf counts as one, and for dynamics of less than 32 nodes: some minutes
LARGEST_WEIGHT = 2**24
STILL = "still"


def is_upper_bound(document: object) -> bool:
    """Whether a parsed file says that it is one."""
    return isinstance(document, dict) and document.get("format") == FORMAT


def read_upper_bound(document: object, skip_hash: bool = False) -> UpperBound:
    """From a parsed file.

    Raises:
        Unreadable, Broken, ValueError: says what was expected where.
    """
    form, version, problem, beta, margin, places, tree, sealed = Item(document, "").record(
        "format", "version", "problem", "beta_lower", "margin", "places", "tree", "hash"
    )
    form.choice(FORMAT)
    version.integer(VERSION, VERSION)
    assert isinstance(document, dict)  # it has fields
    if not skip_hash and sealed.value != document_hash(document):
        sealed.refuse("the hash of the file's content")
    claim = problem_of(problem)
    row = Row(claim, dynamics_of(claim.car), beta.positive())
    found = tuple(_place(entry, row) for entry in places.items(MOST_PLACES))
    each = 1 + len(claim.vehicle.graph.nodes) // 32
    return UpperBound(row, margin.positive(), found, _tree(tree, len(found), Budget(MOST_TERMS // each), MOST_DEPTH))


def _place(item: Item, row: Row) -> Place:
    level, end, direction = item.record("level", "end", "direction")
    height = row.beta_lower if level.choice("inner", "outer") == "inner" else fmpq(1)
    theta = row.duration if end.integer(0, 1) else fmpq(0)
    if isinstance(direction.value, dict):
        (side,) = direction.record(STILL)
        return Place(height, theta, None, 1 if side.choice("right", "left") == "right" else -1)
    cos, sin = (entry.rational() for entry in direction.items(2, 2))
    if cos * cos + sin * sin != 1:
        direction.refuse("a point of the unit circle")
    return Place(height, theta, (cos, sin))


def _tree(item: Item, places: int, budget: Budget, depth: int) -> Tree:
    if isinstance(item.value, dict) and "cut" in item.value:
        if not depth:
            item.refuse(f"a tree of at most {MOST_DEPTH} cuts on the way to a leaf")
        axis, *parts = item.record("cut", "below", "above")
        below, above = (_tree(part, places, budget, depth - 1) for part in parts)
        return Cut(axis.integer(0, UNKNOWNS - 1), below, above)
    budget.spend(1)
    if isinstance(item.value, dict) and "empty" in item.value:
        return Empty(item.record("empty")[0].integer(0, 1))
    terms, conditions = item.record("terms", "conditions")
    rows = terms.items(MOST_IN_LEAF, least=0)
    budget.spend(len(rows))
    weighed = (entry.items(2, 2) for entry in conditions.items(CONDITIONS, least=0))
    return Leaf(
        tuple(_term(row, places) for row in rows),
        tuple((index.integer(0, CONDITIONS - 1), weight.integer(0, LARGEST_WEIGHT)) for index, weight in weighed),
    )


def _term(item: Item, places: int) -> Term:
    place, end, weight = item.items(3, 3)
    return Term(place.integer(0, places - 1), end.integer(0, 1), weight.integer(0, LARGEST_WEIGHT))


def write_upper_bound(
    problem: Mapping[str, Any], beta_lower: fmpq, margin: fmpq, places: Sequence[Mapping[str, Any]], tree: Tree
) -> dict[str, Any]:
    """The file; `problem` and `places` as they stand in it."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "problem": dict(problem),
        "beta_lower": str(beta_lower),
        "margin": str(margin),
        "places": list(places),
        "tree": _written(tree),
    }
    return {**content, "hash": document_hash(content)}


def _written(tree: Tree) -> dict[str, Any]:
    if isinstance(tree, Cut):
        return {"cut": tree.axis, "below": _written(tree.below), "above": _written(tree.above)}
    if isinstance(tree, Empty):
        return {"empty": tree.block}
    return {"terms": [list(term) for term in tree.terms], "conditions": [list(pair) for pair in tree.conditions]}
