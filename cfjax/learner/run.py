"""What a search by elimination has found or shown: the record of each rate, and of all of them.

A message says no more than was shown. Where no ball of radius δ is left, no δ-robust candidate is compatible with these
demonstrations; with revised demonstrations, other centres than that of the largest ellipsoid and a limit in place of a
bound, less than that or nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from cfjax.funnel import Funnel
from cfjax.learner.coefficients import Coordinates
from cfjax.learner.elimination import Elimination
from cfjax.learner.gradient import Learned
from cfjax.learner.localise import Ending, Localised
from cfjax.learner.witnesses import Witnesses, steepness


@dataclass(frozen=True)
class EliminationRun:
    """One search: all there is for `paper`, one rate of `contracting`."""

    how: Elimination
    coordinates: Coordinates
    search: Localised
    funnel: Funnel | None
    margin: float  # 1/s, falsified; −∞ without a funnel
    target: float  # 1/s, the last margin asked for
    witnesses: Witnesses
    half_planes: int  # that were chosen beside obstacles

    @property
    def change(self) -> float | None:
        """Rate · duration; None where it is a coefficient."""
        return self.coordinates.change

    @property
    def bounded(self) -> bool:
        """Whether `search.bound` is a bound for this kind of search, or only a limit."""
        return self.how.centre == "mve" and not self.how.revise

    @property
    def demonstrations(self) -> int:
        return len(self.witnesses.theta)

    @property
    def candidates(self) -> int:
        return len(self.search.history)

    def figures(self) -> dict[str, float | int | str | None]:
        """For result.json."""
        bound = self.search.bound
        return {
            "change": self.change,
            "candidates": self.candidates,
            "cuts": self.search.cuts,
            "bound": bound if self.bounded else None,
            "limit": bound,
            "demonstrations": self.demonstrations,
            "half_planes": self.half_planes,
            "asked": self.target,
            "margin": None if self.funnel is None else self.margin,
            "ending": self.search.ending.value,
        }

    @property
    def message(self) -> str:
        """What was found, and what was shown."""
        found = ""
        if self.funnel is not None:
            found = (
                f"a funnel of margin {self.margin:.4g} 1/s{at_rates([self.change])} after {self.candidates} candidates"
            )
        search, wanted = self.search, f"margin {self.target:.4g} 1/s{self._where()}"
        if search.ending is Ending.FOUND:
            return found
        if search.ending is Ending.SOLVER:
            shown = f"the search for {wanted} failed numerically after {search.cuts} cuts; nothing is shown"
        elif search.ending is Ending.LIMIT:
            shown = f"the search for {wanted} ended after {search.cuts} cuts, its limit; nothing is shown"
        elif search.ending is Ending.GIVEN_UP:
            shown = f"the search for {wanted} was given up after {search.cuts} cuts; nothing is shown"
        elif self.how.revise:
            shown = (
                f"the search for {wanted} ended after {search.cuts} candidates without room for a ball of "
                f"{self.how.delta:g}; demonstrations were revised, so nothing is shown"
            )
        else:
            planes = f" and {self.half_planes} half-planes beside obstacles" if self.half_planes else ""
            most = f"at most {search.bound}" if self.bounded else f"limit {search.bound}, no bound"
            shown = (
                f"no {self.how.delta:g}-robust candidate of {wanted} is compatible with these "
                f"{self.demonstrations} demonstrations{planes} ({search.cuts} cuts, {most})"
            )
        return f"{found}; {shown}" if found else shown

    def _where(self) -> str:
        """What a margin that was asked for means: on which levels, and at which rates."""
        found = self.coordinates
        if found.change is not None or found.beta_inner is not None:
            levels = f" (at V = {found.beta_lower:g}, {self.target / found.beta_lower:.4g} 1/s at V = 1)"
        else:
            levels = f" (at a witness's own level, {steepness(found):.3g} 1/s more for each unit of V above it)"
        if found.change is not None:
            return f"{levels}{at_rates([found.change])}"
        return f"{levels} with c0 T from {found.lower[-1]:.3g} to {found.upper[-1]:.3g}"


@dataclass(frozen=True)
class PolytopeLearned:
    """What the polytope learner found, or what it has shown."""

    learned: Learned | None  # as of the gradient learner
    message: str
    runs: tuple[EliminationRun, ...]

    @property
    def funnels(self) -> tuple[Funnel, ...] | None:
        return self.learned.funnels if self.learned else None

    @property
    def iterations(self) -> int:
        """Candidates of all runs."""
        return sum(run.candidates for run in self.runs)


def at_rates(changes: Sequence[float | None]) -> str:
    """Which rates a message speaks of."""
    listed = [f"{change:.3g}/T" for change in changes if change is not None]
    return f" at rate {', '.join(listed)}" if listed else ""
