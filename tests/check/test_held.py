"""V̇ and V̈ of a vehicle whose dynamics are polynomials, where the chain rule can be applied by hand, exactly."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import pytest
from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from cfcheck.exact.enclosure import LARGEST_EFFORT, Budget, Enclosure, TooLarge
from cfcheck.exact.graph import Graph, Node
from cfcheck.kernel.level import LEVELS
from cfcheck.kernel.program import CellProof
from cfcheck.reader import Broken
from cfcheck.robustness.hold import FROZEN, HeldCell, HeldMotion
from cfcheck.robustness.parametric import Parametric
from cfcheck.robustness.rate_bounds import _prove_sizes


TURN, SPEED, FROZEN_TURN = "reference:turn_rate", "reference:speed", "frozen:turn_rate"
# a' = w - turn_rate u0, b' = (speed + a) a - turn_rate u0 b
GRAPH = Graph(
    (
        Node("input", name="a"),
        Node("input", name="b"),
        Node("input", name="input:u0"),
        Node("input", name="input:w"),
        Node("input", name=TURN),
        Node("input", name=SPEED),
        Node("mul", (4, 2)),
        Node("sub", (3, 6)),
        Node("add", (5, 0)),
        Node("mul", (8, 0)),
        Node("mul", (6, 1)),
        Node("sub", (9, 10)),
    ),
    (7, 11),
)
SHAPE = ((fmpq(4), fmpq(1)), (fmpq(1), fmpq(3)))
WHITENING = ((fmpq(2113, 4096), fmpq(-334, 4096)), (fmpq(-334, 4096), fmpq(2447, 4096)))  # SHAPE^{-1/2}, nearly
RATE = fmpq(1, 5)
BOX = {
    "input:u0": (fmpq(1, 2), fmpq(2)),
    "input:w": (fmpq(-2), fmpq(1)),
    TURN: (fmpq(-1), fmpq(3, 2)),
    SPEED: (fmpq(1), fmpq(1)),
}


@dataclass(frozen=True)
class Counted(HeldMotion):
    """With margins that nobody has to prove, each at the price of half a vertex's budget, or a little less."""

    def proven_margin(self, proof: CellProof) -> fmpq:
        self.domain.budget.spend(LARGEST_EFFORT // 2 - 100_000)
        return proof.margin


def motion(template: str, frozen: bool) -> Counted:
    piece = LEVELS[template](RATE).inside((fmpq(0), fmpq(0)))[0]
    parameters = BOX | ({FROZEN_TURN: BOX[TURN]} if frozen else {})
    spare, degrees = fmpq(1, 7), (2, 1)
    return Counted(GRAPH, ("a", "b"), parameters, spare, SHAPE, WHITENING, piece, {}, {}, degrees)


def by_hand(template: str, at: dict[str, fmpq]) -> tuple[fmpq_mpoly, fmpq_mpoly]:
    """V̇/σ and V̈/σ as polynomials in the state."""
    ring = fmpq_mpoly_ctx.get(["a", "b"], "degrevlex")
    a, b = ring.gens()
    u0, w, speed = at["input:u0"], at["input:w"], at[SPEED]

    def rates(turn: fmpq) -> list[fmpq_mpoly]:
        return [w - turn * u0 + 0 * a, (speed + a) * a - turn * u0 * b]

    q = 4 * a**2 + 2 * a * b + 3 * b**2
    own, looked_at = rates(at[TURN]), rates(at.get(FROZEN_TURN, at[TURN]))

    def along(polynomial: fmpq_mpoly, by: list[fmpq_mpoly]) -> fmpq_mpoly:
        return sum((polynomial.derivative(k) * by[k] for k in range(2)), 0 * a)

    if template == "paper":  # V = q + rate θ
        return along(q, own) + RATE * u0, along(along(q, looked_at), own)
    k = RATE * u0  # V = e^{rate θ} q
    return along(q, own) + k * q, along(along(q, looked_at) + k * q, own) + k * (along(q, own) + k * q)


@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("template", ["paper", "contracting"])
def test_combinations_at_vertices_are_the_chain_rule(template: str, frozen: bool) -> None:
    held = motion(template, frozen)
    assert len(held.vertices) == (16 if frozen else 8)
    point = (fmpq(1, 3), fmpq(-2, 7))
    state = [x(*point) for x in held.deviations]
    for vertex, at in enumerate(held.vertices):
        first, second = by_hand(template, at)
        assert held.first.at(at).enclosure.polynomial(*point) == first(*state)
        assert held.second.at(at).enclosure.polynomial(*point) == second(*state)
        assert held.second.at(at).largest_remainder == 0
        assert held.target(HeldCell(1, vertex))(*point) == -first(*state)
        # of degree four at most: nothing is cut off
        assert held.target(HeldCell(2, vertex))(*point) == -second(*state) - held.spare
        steepness = [abs(first.derivative(k)(*state)) for k in range(2)]
        assert all(float(true) <= float(bound) for true, bound in zip(steepness, held.steepness(vertex), strict=True))
        for slope, true in zip(held.slopes, (first.derivative(k) for k in range(2)), strict=True):
            assert slope.at(at).enclosure.polynomial(*point) == true(*state)


def test_what_is_cut_off_is_left_out_of_the_target() -> None:
    """Of degree two at most instead of four: −V̈ is nowhere below the target."""
    held = replace(motion("contracting", frozen=False), degrees=(1, 0))
    cut = 0
    for vertex, at in enumerate(held.vertices):
        _, second = by_hand("contracting", at)
        target = held.target(HeldCell(2, vertex))
        assert target.total_degree() == 2
        for point in ((fmpq(k, 5), fmpq(j, 5)) for k in range(-4, 5) for j in range(-3, 4)):
            gap = -second(*(x(*point) for x in held.deviations)) - held.spare - target(*point)
            assert gap >= 0
            cut += gap > fmpq(1, 100)
    assert cut


def test_a_remainder_is_left_out_of_the_target_and_part_of_sizes() -> None:
    held, rough = motion("paper", frozen=False), motion("paper", frozen=False)
    domain, error = rough.domain, fmpq(1, 100)
    vague = Parametric.free(Enclosure(domain, rough.ring.constant(0), (error, fmpq(0), fmpq(0))))
    vars(rough)["first"] = held.first + vague * Parametric.parameter(domain, "input:w")
    for vertex, at in enumerate(held.vertices):
        cell, size = HeldCell(1, vertex), error * abs(at["input:w"])
        gap = (held.target(cell) - rough.target(cell))(0, 0)
        assert size <= gap <= size * (1 + fmpq(1, 10**30))
        assert rough.swiftness(vertex) - held.swiftness(vertex) == gap


def proven(held: Counted, effort: int = 10**9) -> tuple[Any, int]:
    """What is made of margins −100, −99, … of the cells, and what is left of the effort."""
    margins = {(cell.order, cell.vertex): (fmpq(k - 100), ()) for k, cell in enumerate(held.cells())}
    budget = Budget(effort)
    terms: Any = SimpleNamespace(wander=fmpq(0))
    return _prove_sizes(held, terms, margins, budget), budget.left


@pytest.mark.parametrize("template", ["paper", "contracting"])
def test_sizes_are_the_largest_at_any_vertex(template: str) -> None:
    held = motion(template, frozen=True)
    sizes, _ = proven(held)
    cells = list(held.cells())
    assert sum(cell.order == 1 for cell in cells) == 8  # where the frozen reference is the reference's own
    assert all(held.vertices[c.vertex][FROZEN_TURN] == held.vertices[c.vertex][TURN] for c in cells if c.order == 1)
    for order, found in ((1, sizes.rise), (2, sizes.bend)):
        assert found == 100 - min(k for k, cell in enumerate(cells) if cell.order == order)
    everywhere = range(len(held.vertices))
    held.domain.budget.left = 10**9
    assert list(sizes.slopes) == [max(each) for each in zip(*map(held.steepness, everywhere), strict=True)]
    assert list(sizes.speeds) == [max(each) for each in zip(*map(held.speeds, everywhere), strict=True)]
    swiftest = max(map(held.swiftness, everywhere))
    assert sizes.stir == (0 if template == "paper" else RATE * BOX["input:u0"][1] * swiftest)


def test_each_vertex_has_a_budget_and_all_have_another_one() -> None:
    held = motion("paper", frozen=True)
    cells = len(list(held.cells()))
    _, left = proven(held)
    spent = 10**9 - left
    assert spent > cells * (LARGEST_EFFORT // 2 - 100_000)  # and what combinations cost
    proven(motion("paper", frozen=True), spent)
    with pytest.raises(TooLarge):
        proven(motion("paper", frozen=True), spent - 1)


def test_a_cell_that_is_missing_is_noticed() -> None:
    held = motion("paper", frozen=True)
    margins = {(cell.order, cell.vertex): (fmpq(0), ()) for cell in held.cells()}
    terms: Any = SimpleNamespace(wander=fmpq(0))
    for key in [*margins, (1, 1)]:
        own = {other: value for other, value in margins.items() if other != key}
        with pytest.raises(Broken, match="cover"):
            _prove_sizes(held, terms, own if key in margins else margins | {key: (fmpq(0), ())}, Budget())


def test_frozen_parameters_stand_for_the_references() -> None:
    held = motion("contracting", frozen=True)
    for at in held.vertices:
        assert held.frozen(at)[TURN] == at[FROZEN_TURN]
        others = {name: value for name, value in at.items() if name != TURN}
        assert {name: held.frozen(at)[name] for name in others} == others
    assert FROZEN_TURN.startswith(FROZEN)
