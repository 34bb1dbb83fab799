"""How much memory and time a proof of condition (d) will take: known before anything is learned.

What the semidefinite programs are made of (states, degrees, references, cells) hardly depends on the funnel, so that
they are counted for one a little inside I. Nothing of them is made for that. What one of them costs a
solver, `cfjax.solver.cost` says.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from flint import fmpq

from cfjax.certificate.certifier import Statement
from cfjax.certificate.stretches import MoreThanIsRead, Stretch, bounded, decreases_on, round_funnel
from cfjax.check.decrease import SteadyDecrease
from cfjax.check.reader import Broken
from cfjax.check.symbolic import symbolic
from cfjax.check.tube import TubeClaim, has_tube_structure
from cfjax.errors import InputError
from cfjax.funnel import Funnel, Template
from cfjax.problem import Problem
from cfjax.solver import DEFAULT
from cfjax.solver.cost import available_memory, cost_of


WORTH_SAYING = 60.0  # s: a proof that takes longer is announced
INSIDE = 0.9  # of I
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
    cells = [sum(1 for question in each for _ in question.cells()) for each in questions]
    costs = [cost_of(solver, states, degrees) for degrees in orders]
    order = max(degrees[0] for degrees in orders)
    return ProofSize(
        states=states,
        order=order,
        references=max(map(len, questions)),
        cells=sum(cells),
        rows=comb(states + 2 * order, states),
        monomials=comb(states + order, states),
        memory=max(cost.memory for cost in costs),
        seconds=sum(count * cost.seconds for count, cost in zip(cells, costs, strict=True)),
    )


def proof_size(
    problem: Problem,
    statement: Statement,
    template: Template,
    beta_lower: float,
    beta_inner: float | None = None,
    solver: str = DEFAULT,
) -> ProofSize | None:
    """Of the problem's proof; None where it cannot be put together for a funnel inside I, which is told elsewhere.

    Segments at constant speed and curvature are alike, and so are the others: one of each is looked at.

    Raises:
        InputError: its Gram matrices would be larger than a checker reads, or its dynamics are not of the form in which
            a few references speak for all.
    """
    claim, distinct = statement.claim, problem.path.distinct
    shape = np.diag(1 / (INSIDE * np.array(problem.inlet.half_axes)) ** 2)
    dynamics = symbolic(statement.graph, claim.vehicle.states, tuple(claim.inputs))
    is_smooth = not has_tube_structure(dynamics)
    found: dict[bool, list[SteadyDecrease]] = {}
    every: list[list[SteadyDecrease]] = []
    for segment, own in zip(distinct, claim.distinct, strict=True):
        is_steady = isinstance(own, TubeClaim) or own.is_steady
        if is_steady not in found:
            rate = 0.0 if isinstance(own, TubeClaim) else CHANGE * beta_lower / segment.duration
            funnel = Funnel(template, shape, rate, segment.duration, beta_lower, beta_inner)
            try:
                if isinstance(own, TubeClaim):
                    stretch = Stretch(fmpq(0), fmpq(0), own)
                else:
                    stretch = bounded(own.pieces, fmpq(0), own.duration, is_smooth)
                found[is_steady] = decreases_on(problem, round_funnel(funnel, segment), statement.graph, stretch)
            except Broken as error:
                raise InputError(str(error)) from None
            except MoreThanIsRead as error:
                raise InputError(
                    f"vehicle {problem.vehicle.name}: expected rates whose proof a checker reads, got {error}; fewer "
                    "states, or functions of simpler arguments, make it smaller"
                ) from None
            except ValueError:
                return None
        every.append(found[is_steady])
    return size_of(every, solver)


def require_room(size: ProofSize, memory: float | None, hours: float, cores: int) -> tuple[int, str]:
    """How many programs to solve side by side, and one line about the proof where it takes long; else an empty one.

    `memory` is in GB; None for what the machine has.

    Raises:
        InputError: one program alone needs more memory, or all of them more time.
    """
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
