"""What a file says of sampled control, read. Shapes and sizes are checked, nothing of it is believed."""

from dataclasses import replace
from math import comb

from flint import fmpq

from cfcheck.claims.hints import Room, read_enclosures, read_gram, read_matrix
from cfcheck.exact.graph import MOST_INPUTS
from cfcheck.exact.rational import bits
from cfcheck.reader import Item
from cfcheck.robustness.ranges import BEND_DEGREES, DEGREES, FORK_DEGREE, ORDERS, SampledClaim, StartUp
from cfcheck.robustness.sampled import Fork, Leaf, Proof, RangeHints, Tree


MOST_CHOICES = 256
MOST_RANGES = 16
RANGES_WITHOUT_CUTS = 3
MOST_FORKS = 24  # on the way to one leaf
LONGEST_FORK = 256  # bits of each coefficient: every leaf below multiplies by them
START_UP = "start_up"
PARTS = 2  # of a range: inside the shell, and on it


def read_sampled(item: Item, states: int, room: Room) -> tuple[SampledClaim, tuple[RangeHints, ...]]:
    """What is stated, and hints for each range of levels.

    Raises:
        Unreadable: says what was expected where.
    """
    late = (START_UP,) if isinstance(item.value, dict) and START_UP in item.value else ()
    period, order, decrease, inputs, bends, cuts, ranges, *start_up = item.record(
        "period", "order", "decrease", "inputs", "bends", "cuts", "ranges", *late
    )
    choices = tuple(_rationals(entry, MOST_INPUTS) for entry in inputs.items(MOST_CHOICES))
    claim = SampledClaim(
        period=period.positive(),
        order=order.integer(min(ORDERS), max(ORDERS)),
        decrease=decrease.positive(),
        choices=choices,
        bends=_rationals(bends, len(choices), len(choices)),
        cuts=_rationals(cuts, MOST_RANGES - RANGES_WITHOUT_CUTS, 0),
    )
    hints = tuple(_range(entry, states, claim, room) for entry in ranges.items(MOST_RANGES))
    return _with_start(start_up[0], claim, hints, states, room) if start_up else (claim, hints)


def _with_start(
    item: Item, claim: SampledClaim, hints: tuple[RangeHints, ...], states: int, room: Room
) -> tuple[SampledClaim, tuple[RangeHints, ...]]:
    """The same with what is stated of late poses, and its proof on each range."""
    delay, choice, rise, proofs = item.record("delay", "choice", "rise", "proofs")
    start_up = StartUp(delay.positive(), choice.integer(0, len(claim.choices) - 1), rise.positive())
    each = (_proof(entry, states, BEND_DEGREES, 0, room) for entry in proofs.items(len(hints), len(hints)))
    with_rise = tuple(replace(own, rise=proof) for own, proof in zip(hints, each, strict=True))
    return replace(claim, start_up=start_up), with_rise


def _rationals(item: Item, most: int, least: int = 1) -> tuple[fmpq, ...]:
    return tuple(entry.rational() for entry in item.items(most, least))


def _range(item: Item, states: int, claim: SampledClaim, room: Room) -> RangeHints:
    whitening, enclosures, bends, trees = item.record("whitening", "enclosures", "bends", "trees")
    count = len(claim.choices)
    return RangeHints(
        whitening=read_matrix(whitening, states),
        enclosures=read_enclosures(enclosures),
        bends=tuple(_proof(entry, states, BEND_DEGREES, 0, room) for entry in bends.items(count, count)),
        trees=tuple(_tree(entry, states, claim, 0, room) for entry in trees.items(PARTS)),
    )


def _tree(item: Item, states: int, claim: SampledClaim, forks: int, room: Room) -> Tree:
    if isinstance(item.value, dict) and "choice" in item.value:
        choice, proofs = item.record("choice", "proofs")
        each = proofs.items(claim.order, claim.order)
        return Leaf(
            choice.integer(0, len(claim.choices) - 1),
            tuple(_proof(entry, states, DEGREES, forks, room) for entry in each),
        )
    if forks == MOST_FORKS:
        item.refuse(f"at most {MOST_FORKS} forks on the way to a leaf")
    coefficients, *sides = item.record("fork", "above", "below")
    size = comb(states + FORK_DEGREE, FORK_DEGREE)
    each = _rationals(coefficients, size, size)
    if max(map(bits, each)) > LONGEST_FORK:
        coefficients.refuse(f"coefficients of at most {LONGEST_FORK} bits")
    above, below = (_tree(side, states, claim, forks + 1, room) for side in sides)
    return Fork(each, above, below)


def _proof(item: Item, states: int, degrees: tuple[int, int], forks: int, room: Room) -> Proof:
    """Gram matrices of the free square, of each fork, and of the ends of the range: the lower one may be 0."""
    margin, grams = item.record("margin", "grams")
    square, other = (comb(states + degree, degree) for degree in degrees)
    tables = grams.items(forks + 3, forks + 2)
    sizes = [square, *[other] * (len(tables) - 1)]
    room.take(sum(size * (size + 1) // 2 for size in sizes), item)
    return margin.rational(), tuple(read_gram(table, size) for table, size in zip(tables, sizes, strict=True))
