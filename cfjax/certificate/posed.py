"""Whether condition (d) can be posed for a problem, whatever the funnel: known before anything is learned.

What the proof of a funnel is made of (degrees, terms, cells) depends on the vehicle, the bounds of the reference and
the states, hardly on the funnel. So it is put together once for the least funnel that can be asked about, one a little
inside I, on the first cell of the path: where that cannot be done, no funnel that holds I has a proof of this kind.
"""

import numpy as np
from flint import fmpq

from cfcheck.claims.hints import MOST_GRAM_ENTRIES
from cfcheck.kernel.decrease import SteadyDecrease
from cfcheck.path.bounds import Bounds
from cfcheck.reader import Broken
from cfcheck.vehicle.structure import has_tube_structure
from cfjax.certificate.certifier import Statement
from cfjax.certificate.plan import CELLS
from cfjax.certificate.rounding import round_funnel
from cfjax.certificate.stretches import ThetaInterval, bounded, decreases_on, entries_of, question_of
from cfjax.coerce import objects
from cfjax.errors import InputError
from cfjax.funnel import Funnel, Template
from cfjax.problem import Problem


INSIDE = 0.9  # of I: bounds on a funnel that are not sharp refuse none that holds I


def least_funnel(
    problem: Problem, kind: int, template: Template, beta_lower: float, beta_inner: float | None, change: float = 0.0
) -> Funnel:
    """A funnel a little inside I for one of the path's distinct segments.

    `change` is that of its level along the segment, of which a tube has none.
    """
    duration = problem.path.distinct[kind].duration
    shape = np.diag(1 / (INSIDE * np.array(problem.inlet.half_axes)) ** 2)
    return Funnel(template, shape, change / duration, duration, beta_lower, beta_inner)


def put_together(
    problem: Problem, statement: Statement, kind: int, share: fmpq, funnel: Funnel
) -> list[SteadyDecrease]:
    """Condition (d) of the funnel along a share of one of the path's distinct segments.

    Raises:
        ValueError, Broken: as `decreases_on` and `bounded`.
    """
    claim, rounded = statement.claim, round_funnel(funnel, problem.path.distinct[kind])
    question = question_of(claim, rounded)
    if isinstance(claim.course, Bounds):
        stretch = ThetaInterval(fmpq(0), fmpq(0), claim.course)
    else:
        pieces = statement.pieces(kind)
        duration = pieces[-1].theta + pieces[-1].duration
        stretch = bounded(pieces, fmpq(0), share * duration, not has_tube_structure(question.dynamics))
    return decreases_on(question, rounded, stretch)


def require_posable(
    problem: Problem, statement: Statement, template: Template, beta_lower: float, beta_inner: float | None = None
) -> None:
    """Put condition (d) together for a funnel a little inside I, and count what a certificate would hold.

    Raises:
        InputError: it cannot be put together, or not written for so many segments; says what was expected.
    """
    objects(problem=(problem, Problem), statement=(statement, Statement), template=(template, Template))
    distinct = problem.path.distinct
    vehicle = f"vehicle {problem.vehicle.name}: expected dynamics of which a proof can be put together"
    try:
        funnel = least_funnel(problem, 0, template, beta_lower, beta_inner)
        questions = put_together(problem, statement, 0, fmpq(1, CELLS), funnel)
    except Broken as error:
        raise InputError(str(error)) from None
    except ValueError as error:
        raise InputError(f"{vehicle}, already inside sets.inlet; got: {error}") from None
    entries = entries_of(questions)
    if entries > MOST_GRAM_ENTRIES:
        raise InputError(
            f"{vehicle} from at most {MOST_GRAM_ENTRIES} entries of Gram matrices, got {entries} for one stretch"
        )
    if len(distinct) * entries > MOST_GRAM_ENTRIES:
        raise InputError(
            f"path {problem.path.name}: expected at most {MOST_GRAM_ENTRIES // entries} distinct segments, as one "
            f"certificate holds the proofs of so many funnels, got {len(distinct)}; longer segments "
            "(path.segment_length) are fewer, and certificate=tube needs one funnel for all of them"
        )
