"""How much memory and time a proof of condition (d) will take: known before anything is learned.

What the semidefinite programs are made of (states, degrees, references, cells) hardly depends on the funnel, so that
they are counted for one a little inside I. Nothing of them is made for that. What one costs a solver,
`cfjax.solver.cost` says.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

from flint import fmpq

from cfcheck.exact.enclosure import TooLarge
from cfcheck.kernel.decrease import SteadyDecrease
from cfjax.certificate.certifier import Statement
from cfjax.certificate.posed import least_funnel, put_together
from cfjax.coerce import number, objects, one_of, whole
from cfjax.errors import InputError
from cfjax.funnel import Template
from cfjax.funnel.levels import inner_level
from cfjax.problem import Problem
from cfjax.solver import DEFAULT, SOLVERS
from cfjax.solver.cost import MOST_MEMORY, available_memory, cost_of
from cfjax.solver.program import Shape


WORTH_SAYING = 60.0  # s: a proof that takes longer is announced
CHANGE = 0.02  # of V's level along a segment: as good as none, but the shell then has its two pieces
GB, MINUTE, HOUR = 1e9, 60.0, 3600.0


@dataclass(frozen=True)
class ProofSize:
    """One stretch of each distinct segment: curved ones may be cut into more."""

    states: int
    order: int  # of the largest Gram matrices; V̇ has at most twice this degree
    references: int  # of the stretch that has most
    cells: int  # semidefinite programs, of all segments
    rows: int  # equations of one of them
    monomials: int  # rows of its largest Gram matrix
    memory: float  # bytes, of one of them
    seconds: float  # of all of them on one core
    shapes: tuple[Shape, ...]  # of the programs, each once

    def workers(self, cores: int, memory: float) -> int:
        """How many programs are solved side by side within so many bytes; at least one."""
        return max(1, min(cores, int(memory // self.memory)))

    def __str__(self) -> str:
        references = "1 reference" if self.references == 1 else f"{self.references} references"
        return (
            f"{self.cells} semidefinite programs ({self.states} states, V' of degree {2 * self.order}, {references} at "
            f"a time), each of {self.rows} equations with matrices of up to {self.monomials} rows"
        )


def size_of(questions: Sequence[Sequence[SteadyDecrease]], solver: str = DEFAULT) -> ProofSize:
    """Of what has to be shown, for each segment at each of its extreme references, by a solver of this name."""
    states, orders = len(questions[0][0].states), [each[0].degrees for each in questions]
    programs = [question.degrees_of(cell) for each in questions for question in each for cell in question.cells()]
    costs = {degrees: cost_of(solver, states, degrees) for degrees in dict.fromkeys(programs)}
    order = max(degrees[0] for degrees in orders)
    return ProofSize(
        states=states,
        order=order,
        references=max(map(len, questions)),
        cells=len(programs),
        rows=comb(states + 2 * order, states),
        monomials=comb(states + order, states),
        memory=max(cost.memory for cost in costs.values()),
        seconds=sum(costs[degrees].seconds for degrees in programs),
        shapes=tuple((states, degrees) for degrees in costs),
    )


def proof_size(
    problem: Problem,
    statement: Statement,
    template: Template,
    beta_lower: float,
    beta_inner: float | None = None,
    solver: str = DEFAULT,
) -> ProofSize | None:
    """Of the problem's proof; None where it cannot be put together for all of a segment at once.

    Segments at constant speed and curvature are alike, and so are the others: one of each is looked at.

    Raises:
        InputError: it is more than a checker takes.
    """
    objects(problem=(problem, Problem), statement=(statement, Statement), template=(template, Template))
    beta_lower = number("beta_lower", beta_lower, above=0, below=1)
    beta_inner = inner_level(beta_inner, beta_lower)
    one_of("solver", solver, SOLVERS)
    change = CHANGE * (beta_lower if beta_inner is None else beta_inner)
    found: dict[bool, list[SteadyDecrease]] = {}
    every = []
    for kind, segment in enumerate(problem.path.distinct):
        alike = segment.is_steady
        if alike not in found:
            try:
                funnel = least_funnel(problem, kind, template, beta_lower, beta_inner, change)
                found[alike] = put_together(problem, statement, kind, fmpq(1), funnel)
            except TooLarge as error:
                raise InputError(f"vehicle {problem.vehicle.name}: expected a smaller proof, got: {error}") from None
            except ValueError:  # Broken among them: it is the proof, or `require_posable`, that says what is wrong
                return None
        every.append(found[alike])
    return size_of(every, solver)


def require_room(size: ProofSize, memory: float | None, hours: float, cores: int) -> tuple[int, str]:
    """How many programs to solve side by side, and one line about the proof where it takes long; else an empty one.

    `memory` is in GB; None for what the machine has.

    Raises:
        InputError: one program alone needs more memory, or all of them more time.
    """
    objects(size=(size, ProofSize))
    memory = None if memory is None else number("proof.memory", memory, "GB", above=0, most=MOST_MEMORY)
    hours, cores = number("proof.hours", hours, "h", above=0), whole("cores", cores, 1)
    room = available_memory() if memory is None else GB * memory
    whose = "which is free here" if memory is None else "as proof.memory says"
    if size.memory > room:
        raise InputError(
            f"proof.memory: expected at most {room / GB:.3g} GB, {whose}, got a proof of {size}: about "
            f"{size.memory / GB:.3g} GB; fewer states, or rates of a lower degree, make it smaller"
        )
    workers = size.workers(cores, room)
    seconds = size.seconds / workers
    if seconds > HOUR * hours:
        raise InputError(
            f"proof.hours: expected at most {hours:g} h, got a proof of {size}: about {seconds / HOUR:.3g} h; fewer "
            "states, fewer segments, or rates of a lower degree, make it shorter"
        )
    if seconds <= WORTH_SAYING:
        return workers, ""
    time = f"{seconds / MINUTE:.2g} min" if seconds < HOUR else f"{seconds / HOUR:.2g} h"
    return workers, f"proof: {size}: about {time} and {size.memory * workers / GB:.2g} GB, if nothing is cut further"
