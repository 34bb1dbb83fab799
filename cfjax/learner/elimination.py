"""How learner=polytope looks (`cfjax.learner.polytope`): its keys, `polytope.…`, apart from the search itself."""

from dataclasses import dataclass

from cfjax.coerce import flag, keep, number, one_of, whole


CENTRES = ("mve", "analytic", "chebyshev")
DEMONSTRATIONS = ("mpc", "revised")


@dataclass(frozen=True)
class Elimination:
    """How the learner by elimination looks.

    Raises:
        InputError: for values that are none of these; names the key, `polytope.…`.
    """

    margin: float = 0.05  # 1/s, λ that is asked for first
    climb: bool = True  # whether more is asked for when a funnel was found, until no room is left
    centre: str = "mve"  # where the next candidate is: "mve" (maximum-volume ellipsoid), "analytic" or "chebyshev"
    batch: int = 8  # counterexamples that answer one candidate, at most
    demonstrations: str = "mpc"  # "mpc"; or "revised": those too, but chosen anew after every candidate
    delta: float = 0.01  # radius of the ball of coefficients that has to be left; C in half-axes of I, Frobenius norm

    def __post_init__(self) -> None:
        one_of("polytope.centre", self.centre, CENTRES)
        one_of("polytope.demonstrations", self.demonstrations, DEMONSTRATIONS)
        keep(
            self,
            margin=number("polytope.margin", self.margin, "1/s", above=0),
            climb=flag("polytope.climb", self.climb),
            batch=whole("polytope.batch", self.batch, 1),
            delta=number("polytope.delta", self.delta, above=0, below=1),
        )

    @property
    def revise(self) -> bool:
        """Whether demonstrations are chosen anew after every candidate."""
        return self.demonstrations == "revised"
