"""What vertices do not see: by how much V̈ may exceed its largest value at a vertex of the parameters' box.

V̈ of a car that holds its inputs is quadratic in each parameter (`cfcheck.robustness.hold`). Its coefficient of p_i² is
a square plus a rest, rest ≥ −δ_i: with δ_i (p_i − lower)(p_i − upper) added it is convex in p_i, and what was added
takes away at most δ_i width²/4. So V̈ is largest at a vertex, but for that much.

Where the reference r itself changes, V̈ has one more term, ∂V̇/∂r · r'(θ) u0: it is bounded and added as well.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from flint import fmpq, fmpq_mpoly

from cfcheck.exact.definite import exact_matrix
from cfcheck.exact.rational import Matrix, Range, sqrt_upper
from cfcheck.exact.symbolic import Symbolic
from cfcheck.kernel.level import LevelPiece
from cfcheck.reader import Broken
from cfcheck.robustness.hold import FROZEN, REFERENCE, TIMING
from cfcheck.robustness.term_bounds import TermBounds, slopes_of


def require_affine(dynamics: Symbolic, parameters: Mapping[str, Range]) -> None:
    """Raises Broken unless the dynamics are affine in each parameter that varies, the functions in them free of it."""
    varying = {name for name, (lower, upper) in parameters.items() if lower < upper}
    indices = {index for index, name in enumerate(dynamics.names) if name in varying}
    for function, argument in dynamics.functions.values():
        if any(int(exponents[index]) for exponents in argument.to_dict() for index in indices):
            raise Broken(f"vehicle: held inputs need dynamics whose {function} is of the states alone")
    for rate in dynamics.rates:
        if any(int(exponents[index]) > 1 for exponents in rate.to_dict() for index in indices):
            raise Broken("vehicle: held inputs need dynamics that are affine in each input")


@dataclass(frozen=True)
class Terms:
    """Sizes of terms of V̇ and V̈ over one range of levels: every polynomial bounded term by term.

    `parameters` as in `HeldMotion`; `slopes` bounds |dr/dθ| of the reference's, where that is looked at. With other
    references to look at, the dynamics have to be those of a tube (`cfcheck.vehicle.structure`): what jumps multiplies
    u0 alone.
    """

    dynamics: Symbolic
    states: tuple[str, ...]
    parameters: Mapping[str, Range]
    slopes: Mapping[str, fmpq]
    shape: Matrix
    piece: LevelPiece

    @cached_property
    def ranges(self) -> dict[str, Range]:
        """Of states and parameters."""
        inverse = exact_matrix(self.shape).inv()
        widths = [sqrt_upper(self.piece.upper * inverse[j, j]) for j in range(len(self.shape))]
        return {name: (-width, width) for name, width in zip(self.states, widths, strict=True)} | {**self.parameters}

    def size(self, polynomial: fmpq_mpoly) -> fmpq:
        """A rational that is at least |polynomial|."""
        return TermBounds(self.dynamics, self.ranges).size(polynomial)

    def derivative(self, polynomial: fmpq_mpoly, name: str) -> fmpq_mpoly:
        """∂/∂(a state or parameter)."""
        return slopes_of(self.dynamics).derivative(polynomial, name)

    @cached_property
    def spare(self) -> fmpq:
        """What V̈/σ may be above its largest value at a vertex beside a steady reference."""
        linear = {name for frozen in self.jumps for name in (frozen, frozen.replace(FROZEN, REFERENCE))}
        varying = {name: upper - lower for name, (lower, upper) in self.parameters.items() if name not in linear}
        rests = (self.rest(name) * width**2 / 4 for name, width in varying.items() if width)
        return sum(rests, self.wander)

    @cached_property
    def jumps(self) -> dict[str, fmpq]:
        """Parameters at which V̇ is looked at, with the widths of their intervals."""
        return {name: upper - lower for name, (lower, upper) in self.parameters.items() if name.startswith(FROZEN)}

    @cached_property
    def wander(self) -> fmpq:
        """|∂V̇/∂r · r'(θ) u0|/σ: how fast V̇ changes by the reference alone."""
        fastest = self.parameters[TIMING][1]
        return sum((fastest * slope * self.gain(name) for name, slope in self.slopes.items() if slope), fmpq(0))

    @cached_property
    def _gains(self) -> dict[str, fmpq]:
        return {}

    def gain(self, name: str) -> fmpq:
        """|∂V̇/∂(parameter)|/σ."""
        if name not in self._gains:
            self._gains[name] = self._uphill([self.derivative(rate, name) for rate in self.dynamics.rates])
        return self._gains[name]

    def _uphill(self, direction: Sequence[fmpq_mpoly]) -> fmpq:
        """|∇q · direction|."""
        gradient = (2 * sqrt_upper(self.piece.upper * self.shape[j][j]) for j in range(len(self.shape)))
        each = zip(gradient, direction, strict=True)
        return sum((size * self.size(entry) for size, entry in each), fmpq(0))

    def rest(self, name: str) -> fmpq:
        """How negative the coefficient of the parameter's square in V̈/σ can be: ∇q·(∂b/∂x) b, b = ∂f/∂(parameter).

        With V's own rate, u0² has 2 k ∇q·b as well; the squares 2 bᵀCb and k² q are left out.
        """
        dynamics = self.dynamics
        b = [self.derivative(rate, name) for rate in dynamics.rates]
        if name == TIMING and self.jumps:
            return self._rest_apart(b)
        turned = []
        for entry in b:
            slopes = (self.derivative(entry, state) for state in self.states)
            terms = (dynamics.domain.product(one, two) for one, two in zip(slopes, b, strict=True))
            turned.append(sum(terms, dynamics.domain.ring.constant(0)))
        own = 2 * abs(self.piece.timing.slope) * self._uphill(b) if name == TIMING else fmpq(0)
        return self._uphill(turned) + own

    def _rest_apart(self, b: Sequence[fmpq_mpoly]) -> fmpq:
        """The same of u0², where b(r) and b(r') differ: 2 b(r)ᵀC b(r') ≥ −½ (b(r) − b(r'))ᵀC (b(r) − b(r'))."""
        each = range(len(b))
        size = [self.size(entry) for entry in b]
        gradient = [2 * sqrt_upper(self.piece.upper * self.shape[j][j]) for j in each]
        turned = sum(
            (
                gradient[i] * self.size(self.derivative(b[i], state)) * size[j]
                for i in each
                for j, state in enumerate(self.states)
            ),
            fmpq(0),
        )
        apart = [
            sum(
                (
                    width * self.size(self.derivative(entry, name.replace(FROZEN, REFERENCE)))
                    for name, width in self.jumps.items()
                ),
                fmpq(0),
            )
            for entry in b
        ]
        square = sum((abs(self.shape[i][j]) * apart[i] * apart[j] for i in each for j in each), fmpq(0))
        return turned + square / 2
