"""The funnels along a path as arrays, for one car at a time: which funnel holds at θ, the reference there, and V.

θ counts along the whole path, in s. On a path whose end meets its start it goes on into the next lap, and below 0 lies
the one before; on others the last funnel and the last piece of the reference go on past the end.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cfjax.control import LawNumbers
from cfjax.control.legs import leg_arrays
from cfjax.errors import InputError
from cfjax.funnel import Leg, Template
from cfjax.problem import Problem, ReferencePoint, Vehicle, to_deviation
from cfjax.problem.course import Pieces, point_at, poses_of, profiles_of


class TrackPoint(NamedTuple):
    """What there is at one θ; scalars, and the arrays of one funnel."""

    since: Float[Array, ""]  # θ as the funnel counts it, s
    numbers: LawNumbers
    point: ReferencePoint
    pose: tuple[Array, Array, Array]  # heading (rad) and position (m) of the reference


class Track(eqx.Module):
    """Legs along a path; every array has a leading axis of legs, but for the path's pieces."""

    vehicle: Vehicle = eqx.field(static=True)
    template: Template = eqx.field(static=True)
    numbers: LawNumbers
    begin: Float[Array, " l"]
    profiles: Pieces
    poses: Pieces
    duration: Float[Array, ""]  # of one lap, s
    laps: Float[Array, ""]  # 1 on a path that does not close
    closed: Float[Array, ""]  # 1 where the end meets the start: then θ < 0 is the end of the lap before; else 0
    safe: Float[Array, " n"]  # half-widths of S; infinite where there is none
    goal: Float[Array, " n"]  # half-axes of G

    @property
    def end(self) -> Float[Array, ""]:
        """θ at which the last lap ends, s."""
        return self.laps * self.duration

    def at(self, theta: Float[Array, ""]) -> TrackPoint:
        """The funnel and the reference at θ; where two funnels meet, the later one."""
        lap = jnp.clip(jnp.floor(theta / self.duration), -self.closed, self.laps - 1)
        own = theta - lap * self.duration
        leg = jnp.clip(jnp.searchsorted(self.begin, own, side="right") - 1, 0, self.begin.shape[0] - 1)
        leg = 0 if self.begin.shape[0] == 1 else leg  # one for all is no look-up
        numbers = jax.tree.map(lambda leaf: leaf[leg], self.numbers)
        here = own[None]  # the path is read for many at once
        point = point_at(self.profiles, self.profiles.find(here), here)
        alpha, x, y = (value for value, _ in self.poses.at(self.poses.find(here), here))
        point, pose = jax.tree.map(lambda value: jnp.asarray(value, float).reshape(()), (point, (alpha, x, y)))
        return TrackPoint(own - self.begin[leg], numbers, point, pose)

    def deviation(self, place: TrackPoint, state: Float[Array, " n"]) -> Float[Array, " n"]:
        """Of a car's state (α, x, y, ξ…) from the reference, in its frame; the heading in [−π, π)."""
        return jnp.stack(to_deviation(self.vehicle, tuple(state), place.pose, place.point))

    def value(self, place: TrackPoint, x: Float[Array, " n"]) -> Float[Array, ""]:
        """V at a deviation."""
        form = x @ place.numbers.shape @ x
        return jnp.asarray(self.template.value(place.numbers.rate, place.since, form), float)

    def gradient(self, place: TrackPoint, x: Float[Array, " n"]) -> Float[Array, " n"]:
        """∂V/∂x, but for a factor that is positive."""
        return jnp.asarray(place.numbers.shape) @ x


def track_of(problem: Problem, legs: Sequence[Leg], laps: int = 1) -> Track:
    """The track of a path's legs (`Result.legs`); several laps need a path that closes.

    Raises:
        InputError: for laps of a path that does not close; as `leg_arrays`.
    """
    path, arrays = problem.path, leg_arrays(problem, legs)
    if laps < 1 or (laps > 1 and not path.closed):
        raise InputError(f"laps: expected 1 on the path {path.name}, whose end does not meet its start, got {laps}")
    return Track(
        vehicle=problem.vehicle,
        template=arrays.template,
        numbers=jax.tree.map(jnp.asarray, arrays.numbers),
        begin=jnp.asarray(arrays.begin),
        profiles=jax.tree.map(jnp.asarray, profiles_of(path)),  # programs close over a track
        poses=jax.tree.map(jnp.asarray, poses_of(path, problem.side_slip)),
        duration=jnp.asarray(arrays.end[-1]),
        laps=jnp.asarray(float(laps)),
        closed=jnp.asarray(float(path.closed)),
        safe=jnp.array(problem.safe.half_widths if problem.safe else (np.inf,) * problem.dimension),
        goal=jnp.array(problem.goal_axes),
    )
