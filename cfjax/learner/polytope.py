"""The polytope learner: funnels by elimination of coefficients, from counterexamples and demonstrations.

As in Ravanbakhsh and Sankaranarayanan (`cfjax.learner.localise`). V is linear in its coefficients, so a condition at
one point with one input is a half-space of them. The falsifier finds points (θ, x) at which a candidate fails; a
demonstrator says what input it would give there; from then on V̇ along that input has to fall there
(`cfjax.learner.witnesses`). The candidate fails with its best input, so it fails with the demonstrated one: every
answer cuts it off. (a), (b), (c) are half-spaces at their worst points too (`cfjax.learner.coefficients`), beside
obstacles by half-planes (`cfjax.learner.clearance_cuts`).

**What is lost.** Condition (d) says: for each point *of a funnel's own shell* there is *some* input. Here each
candidate answers for each witness, though only the shell of the candidate that failed there is known to hold it: by a
half-space that stands for the condition and is not the condition itself. And it has to fall along the one input that
was demonstrated, though another may be better for it. A funnel may exist that does neither. So where no ball of radius
δ is left, this is what was shown: **no δ-robust candidate is compatible with these demonstrations**; with another
demonstrator, one may be.

**Revised demonstrations.** With `revise` inputs are no longer given once for all: after every candidate those of all
witnesses are chosen anew (`cfjax.learner.revision`). This gives back the second half of the freedom, and it costs the
bound: half-spaces are taken back, the polytopes are not nested, and an end without a funnel shows nothing. Such a
search is given up when so many candidates in a row are no funnel (`cfjax.learner.oracle.PATIENCE`).
"""

import math
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

from cfjax.coerce import number, numbers, objects, whole
from cfjax.errors import InputError
from cfjax.falsifier.falsifier import falsify
from cfjax.funnel import Template
from cfjax.funnel.conditions import CLEAR, chain_excess
from cfjax.funnel.instance import Chain, Unit, chain_of
from cfjax.funnel.levels import inner_level
from cfjax.funnel.template import Paper
from cfjax.learner.coefficients import GAP, Coordinates
from cfjax.learner.demonstrations import Demonstrate
from cfjax.learner.elimination import Elimination
from cfjax.learner.gradient import Learned
from cfjax.learner.localise import localise
from cfjax.learner.oracle import FunnelOracle
from cfjax.learner.run import EliminationRun, PolytopeLearned, at_rates
from cfjax.problem import Problem


# rate · duration, where the template's rate is not a coefficient; below zero the funnel grows, where it may
CHANGES = (0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, -0.3, -1.0)


def learn_polytope(
    problem: Problem,
    template: Template,
    how: Elimination = Elimination(),
    *,
    beta_lower: float = 0.9,
    beta_inner: float | None = None,
    demonstrate: Demonstrate | None = None,
    changes: Sequence[float] = CHANGES,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> PolytopeLearned:
    """A funnel of margin at least `how.margin` (ε, 1/s), by elimination; or what was shown in looking for it.

    `demonstrate` maps θ (k,), s, and deviations (k, n) to inputs (u0, u) of shape (k, 1 + m) within the box; where
    demonstrations are revised it may be left out. Each candidate is answered by at most `how.batch` witnesses of (d).
    With `how.climb` the search does not end at the first funnel: more margin than it has is asked for, all earlier
    demonstrations are held to it, and the best funnel comes back when no room is left. `changes` are the values of
    rate · duration that are tried with a template that is not linear in its rate; without `climb` the first that leads
    to a funnel is the last.

    Raises:
        InputError: for a tube or a chain of several distinct segments, a reference that touches an obstacle, and
            demonstrations that are no inputs.
    """
    objects(problem=(problem, Problem), template=(template, Template), how=(how, Elimination))
    beta_lower = number("beta_lower", beta_lower, above=0, below=1)
    beta_inner = inner_level(beta_inner, beta_lower)
    seed, changes = whole("seed", seed, 0), numbers("changes", changes)
    chain = _chain(problem, template, beta_lower, beta_inner)
    if demonstrate is None and not how.revise:
        raise InputError("polytope.demonstrations: expected revised where no demonstrator is given")
    lowest, highest = (float(bound[0]) for bound in chain.funnels.change_bounds)
    rate_changes = [None] if isinstance(template, Paper) else [c for c in changes if lowest <= c <= highest]
    runs: list[EliminationRun] = []
    roomless: list[float | None] = []
    for k, change in enumerate(rate_changes):
        coordinates = Coordinates.of(template, chain, beta_lower, beta_inner, change)
        if coordinates is None:
            roomless.append(change)
            continue
        best = max((run.margin for run in runs), default=-math.inf)
        margin = max(how.margin, best) if how.climb else how.margin  # a later rate has to pass the best so far
        oracle = FunnelOracle(problem, template, chain, coordinates, demonstrate, how, margin, seed)
        report = None if progress is None else (lambda done, of, k=k: progress(k * of + done, len(rate_changes) * of))
        search = localise(
            coordinates.lower,
            coordinates.upper,
            oracle,
            delta=how.delta,
            centre=how.centre,
            known=coordinates.known(),
            progress=report,
        )
        runs.append(oracle.run(search))
        if runs[-1].funnel is not None and not how.climb:
            break
    found = max(reversed(runs), key=lambda run: run.margin, default=None)
    if found is not None and found.funnel is not None:
        return PolytopeLearned(_learned(problem, chain, found, runs, seed), found.message, tuple(runs))
    said = list(dict.fromkeys(run.message for run in runs))
    if roomless:
        said.append(f"(a)–(c) leave no room{at_rates(roomless)}")
    if not isinstance(template, Paper):
        said.append("no other rates were tried")
    return PolytopeLearned(None, "; ".join(said), tuple(runs))


def _chain(problem: Problem, template: Template, beta_lower: float, beta_inner: float | None) -> Chain:
    """The numbers of the one funnel whose coefficients are looked for."""
    problem.path.require_course()
    if len(problem.path.distinct) > 1:
        raise InputError(
            f"learner=polytope: expected one distinct segment, got {len(problem.path.distinct)}: its coefficients are "
            "those of one funnel"
        )
    chain = chain_of(problem, template, beta_lower, beta_inner, Unit.SECOND)
    gap = np.asarray(chain.funnels.clearance.gap)[0]
    if len(gap) and not gap.max(axis=1).min() > CLEAR * (1 + GAP):
        theta = float(chain.funnels.clearance.theta[0][gap.max(axis=1).argmin()])
        raise InputError(
            f"obstacles: expected more than {CLEAR:g} m between them and the body on the reference itself, got "
            f"{gap.max(axis=1).min():.3g} m at θ = {theta:.3g} s"
        )
    return chain


def _learned(
    problem: Problem, chain: Chain, found: EliminationRun, runs: Sequence[EliminationRun], seed: int
) -> Learned:
    funnel = found.funnel
    assert funnel is not None
    factor = np.linalg.cholesky(np.linalg.inv(funnel.shape))[None]
    excess = chain_excess(funnel.template, chain, jnp.asarray(factor), jnp.asarray([funnel.rate]))
    points = falsify(problem, problem.path.distinct[0], funnel, seed=seed + 1)
    margin = min(found.margin, next(point.slack for point in points if point.condition == "d"))
    return Learned(
        funnels=(funnel,),
        margin=margin,
        excess=float(excess.max()),
        margins=(margin,),
        steps=sum(run.candidates for run in runs),
    )
