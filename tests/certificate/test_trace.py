"""The traced graph against JAX; operations without exact arithmetic are refused by name."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.certificate.certifier import statement_of
from cfjax.certificate.rounding import round_funnel
from cfjax.certificate.stretches import ThetaInterval, bounded, decreases_on, question_of
from cfjax.certificate.trace import PROFILE_INPUTS, trace_deviation
from cfjax.errors import InputError
from cfjax.exact import exact_course
from cfjax.funnel import Contracting, Funnel
from cfjax.problem import (
    Interval,
    KinematicBicycle,
    Problem,
    ReferencePoint,
    Twist,
    Vehicle,
    affine_deviation,
    deviation_rate,
    straight,
)


@dataclass(frozen=True)
class SteeredBicycle(Vehicle):
    """Steering angle as a state, its rate as input; side force falls with 1 / (1 + v/10): tan and a real division."""

    wheelbase: float = 0.34

    name: ClassVar[str] = "steered_bicycle"
    internal_names: ClassVar[tuple[str, ...]] = ("v", "delta")
    input_names: ClassVar[tuple[str, ...]] = ("thrust", "steer_rate")

    @property
    def input_box(self) -> tuple[Interval, ...]:
        return Interval(-4.0, 4.0), Interval(-6.0, 6.0)

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        v, delta = internal
        return Twist(turn=v * jnp.tan(delta) / self.wheelbase / (1 + v / 10), lateral=0.0, forward=v)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        thrust, steer_rate = inputs
        return thrust, steer_rate

    def reference(self, turn_rate: object, speed: object) -> tuple[Twist, tuple]:
        return Twist(turn=turn_rate, lateral=0.0, forward=speed), (speed, 0.0 * turn_rate)


class _Exponential(SteeredBicycle):
    name: ClassVar[str] = "exponential"

    def twist(self, internal: tuple, inputs: tuple) -> Twist:
        v, delta = internal
        return Twist(turn=jnp.exp(delta) * v, lateral=0.0, forward=v)


@pytest.mark.parametrize("vehicle", [KinematicBicycle(), SteeredBicycle()])
def test_the_graph_is_the_vehicle(vehicle: Vehicle) -> None:
    graph = trace_deviation(vehicle)
    rng = np.random.default_rng(0)
    functions = {"sin": math.sin, "cos": math.cos, "tan": math.tan, "inv": lambda t: 1 / t}
    inputs = ("u0", *vehicle.input_names)
    for _ in range(30):
        x, u = rng.normal(size=len(vehicle.state_names)), rng.normal(size=len(inputs))
        reference = ReferencePoint(*rng.normal(size=4))
        values = dict(zip(vehicle.state_names, x, strict=True))
        values |= {f"input:{name}": value for name, value in zip(inputs, u, strict=True)}
        values |= {f"reference:{name}": value for name, value in zip(PROFILE_INPUTS, reference, strict=True)}
        given = graph.evaluate(values, float, lambda _, name, t: functions[name](float(t)))
        truth = [float(rate) for rate in deviation_rate(vehicle, tuple(x), tuple(u), reference)]
        np.testing.assert_allclose(np.array(given, float), truth, rtol=1e-12, atol=1e-12)


def test_unknown_operations_are_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"exponential: no exact arithmetic for the operation 'exp'"):
        trace_deviation(_Exponential())


class _Cast(SteeredBicycle):
    """Its thrust goes through what the test says."""

    name: ClassVar[str] = "cast"

    def __init__(self, through: Callable) -> None:
        super().__init__()
        object.__setattr__(self, "through", through)

    def internal_rate(self, internal: tuple, inputs: tuple) -> tuple:
        return self.through(jnp.asarray(inputs[0])), inputs[1]


@pytest.mark.parametrize(
    ("through", "named"),
    [
        (lambda u: u.astype(int) / 2, "cast from float64 to int64"),
        (lambda u: u.astype(jnp.float16) * 1.0, "cast from float64 to float16"),
        (lambda u: u.astype(jnp.float32).astype(float), "cast from float64 to float32"),
        (lambda u: u.astype(bool) * 2.0, "cast from float64 to bool"),
        (lambda u: u * (jnp.int8(100) + jnp.int8(100)), "of int8"),
        (lambda u: u * jax.lax.div(jnp.asarray(1), jnp.asarray(2)), "of int64"),
        (lambda u: u * (jnp.float32(0.1) * jnp.float32(0.1)), "of float32"),
        (lambda u: jax.jit(jnp.multiply)(u, 2**53 + 1), "no 64-bit floating-point number"),
    ],
)
def test_casts_that_change_numbers_are_refused_by_name(through: Callable, named: str) -> None:
    with pytest.raises(InputError, match=named):
        trace_deviation(_Cast(through))


def test_constants_of_other_types_are_their_values() -> None:
    for two in (2.0, 2, jnp.asarray(2), np.int8(2), jnp.asarray(2.0)):
        graph = trace_deviation(_Cast(lambda u, two=two: u * two))
        values = dict.fromkeys(graph.inputs(), 0.0) | {"input:thrust": 1.5}
        rates = graph.evaluate(values, float, lambda _, name, t: 1.0 if name == "inv" else getattr(math, name)(t))
        assert rates[3] == 3.0


@pytest.mark.parametrize("function", ["sin", "cos", "tan", "sqrt"])
def test_a_function_of_a_constant_is_one(function: str) -> None:
    """As JAX computes it: of a vehicle's own angle nothing is left to enclose."""
    plain = trace_deviation(_Cast(lambda u: u))
    graph = trace_deviation(_Cast(lambda u: u * getattr(jnp, function)(0.3)))
    assert sorted(graph.functions().values()) == sorted(plain.functions().values())
    used = {argument for node in graph.nodes for argument in node.args}
    before = {node.value for node in plain.nodes}
    (scale,) = {graph.nodes[index].value for index in used} - before
    assert float(scale) == pytest.approx(getattr(math, function)(0.3), rel=1e-15)
    with pytest.raises(InputError, match="expected finite constants"):
        trace_deviation(_Cast(lambda u: u * jnp.sqrt(-0.3)))


def test_tan_and_division_are_enclosed_on_the_funnel(monkeypatch: pytest.MonkeyPatch) -> None:
    """No extra work for a new vehicle: its targets lie below the truth, by the dynamics of `cfjax.problem`.

    A proof of this one, of degree 8 in five states, is more than a checker does; nothing is proven here.
    """
    from flint import fmpq

    monkeypatch.setattr("cfjax.certificate.stretches._require_readable", lambda *_: None)
    vehicle = SteeredBicycle()
    problem = Problem(straight(4.0), vehicle=vehicle, **{n: _ball(0.5, 5) for n in ("inlet", "goal")})
    segment = problem.path.segments[0]
    shape = np.diag([3.0, 3.0, 3.0, 3.0, 8.0]) + 0.2
    rounded = round_funnel(Funnel(Contracting(), shape, 0.2, segment.duration), segment)
    decrease = decreases_on(question_of(statement_of(problem).claim, rounded), rounded, _whole(problem))[0]
    assert {unary.function for unary in decrease.enclosures.values()} == {"sin", "cos", "tan", "inv"}
    whitening = np.array([[float(w) for w in row] for row in decrease.whitening])
    cells = list(decrease.cells())
    rng = np.random.default_rng(0)
    for _ in range(20):
        direction = rng.normal(size=5)
        y = [fmpq(round(v * 10**6), 10**6) for v in rng.uniform(0, 1) * direction / np.linalg.norm(direction)]
        x = whitening @ np.array([float(v) for v in y])
        drift, columns = (np.asarray(part) for part in affine_deviation(vehicle, jnp.asarray(x), segment.point(0.0)))
        for cell in cells[:: len(cells) // 4]:
            u = np.array([float(v) for v in cell.vertex])
            q = float(rounded.funnel.form(x))
            rate = 2 * x @ rounded.funnel.shape @ (drift + columns @ u) + rounded.funnel.rate * q * u[0]
            below = float(decrease.form_rates[cell.vertex].denominator.polynomial(*y))
            assert below == pytest.approx(1 + (x[3] + 2) / 10, abs=1e-12)
            assert -rate * below >= float(decrease.target(cell)(*y)) - 1e-12
            drop = float(decrease.pieces[cell.piece].weight.at(decrease.form)(*y))
            assert float(decrease.weight(cell)(*y)) == pytest.approx(below * drop)


def test_poles_in_the_funnel_are_refused() -> None:
    vehicle = SteeredBicycle()
    problem = Problem(straight(4.0), vehicle=vehicle, **{n: _ball(0.5, 5) for n in ("inlet", "goal")})
    segment = problem.path.segments[0]
    wide = np.diag([3.0, 3.0, 3.0, 3.0, 0.3])  # the steering angle reaches beyond π/2
    rounded = round_funnel(Funnel(Contracting(), wide, 0.2, segment.duration), segment)
    with pytest.raises(ValueError, match="tan has a pole"):
        decreases_on(question_of(statement_of(problem).claim, rounded), rounded, _whole(problem))
    fast = np.diag([3.0, 3.0, 3.0, 1 / 200, 8.0])  # v + v_r reaches −10 m/s, where 1 + v/10 is zero
    rounded = round_funnel(Funnel(Contracting(), fast, 0.2, segment.duration), segment)
    with pytest.raises(ValueError, match="inv has a pole"):
        decreases_on(question_of(statement_of(problem).claim, rounded), rounded, _whole(problem))


def _whole(problem: Problem) -> ThetaInterval:
    """The one stretch of a steady segment."""
    course = exact_course(problem.path)
    return bounded(course.pieces, course.pieces[0].theta, course.duration)


def _ball(radius: float, dimension: int) -> object:
    from cfjax.problem import ball

    return ball(radius, dimension)
