"""The same optimal-control problem, written for CasADi from the formulas of the paper; of `cfjax` only its numbers.

Kinematic bicycle along a reference of piecewise polynomial turning rate and speed, multiple shooting by one step of
fourth-order Runge–Kutta an interval; the polynomials of an interval are those of the piece in which it begins. On one
piece of constant turning rate and speed θ is no state.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np

from cfjax.demonstrator import weights_of
from cfjax.problem import Problem, Profile


class Reference(NamedTuple):
    begin: list[float]  # of the pieces, s
    turn_rate: list[list[float]]  # ascending coefficients of θ − begin
    speed: list[list[float]]
    end: float


class Cost(NamedTuple):
    state: np.ndarray
    effort: np.ndarray
    terminal: np.ndarray


def solver(
    reference: Reference,
    cost: Cost,
    lower: list[float],
    upper: list[float],
    wheelbase: float,
    steps: int = 20,
    h: float = 0.1,
    name: str = "ipopt",
    options: dict | None = None,
):
    """(x0, θ0) → cost, inputs (steps, 3), success; from the plan of the feed-forward at the start."""
    n = 4 if len(reference.begin) == len(reference.speed[0]) == len(reference.turn_rate[0]) == 1 else 5
    start_at = ca.SX.sym("start", n)

    def pieces(theta):
        """The coefficients that count at θ, and where they count from."""
        begin, omega, v = reference.begin[0], reference.turn_rate[0], reference.speed[0]
        for b, o, s in zip(reference.begin[1:], reference.turn_rate[1:], reference.speed[1:], strict=True):
            later = theta >= b
            begin = ca.if_else(later, b, begin)
            omega = [ca.if_else(later, new, old) for new, old in zip(o, omega, strict=True)]
            v = [ca.if_else(later, new, old) for new, old in zip(s, v, strict=True)]
        return begin, omega, v

    def profile(coefficients, t, on):
        value = sum(c * t**i for i, c in enumerate(coefficients))
        slope = sum(i * c * t ** (i - 1) for i, c in enumerate(coefficients) if i)
        return value, on * slope

    def at(theta, piece):
        begin, omega, v = piece
        t = ca.fmin(ca.fmax(theta, 0), reference.end) - begin
        on = theta < reference.end
        return *profile(omega, t, on), *profile(v, t, on)

    def rate(z, u, piece):
        alpha, x, y, v, theta = (*(z[i] for i in range(4)), z[4] if n == 5 else 0.0)
        omega_r, _, v_r, a_r = at(theta, piece)
        return ca.vertcat(
            (v + v_r) / wheelbase * u[1] - omega_r * u[0],
            -(v + v_r) * ca.sin(alpha) + omega_r * u[0] * y,
            (v + v_r) * ca.cos(alpha) - v_r * u[0] - omega_r * u[0] * x,
            u[2] - a_r * u[0],
            *([u[0]] if n == 5 else []),
        )

    z, u = ca.SX.sym("z", n), ca.SX.sym("u", 3)
    piece = pieces(z[4] if n == 5 else 0.0)
    k1 = rate(z, u, piece)
    k2 = rate(z + h / 2 * k1, u, piece)
    k3 = rate(z + h / 2 * k2, u, piece)
    k4 = rate(z + h * k3, u, piece)
    omega_r, _, v_r, a_r = at(z[4] if n == 5 else 0.0, piece)
    w_r = wheelbase * omega_r / v_r
    rest = ca.vertcat(1, ca.fmin(ca.fmax(w_r, lower[1]), upper[1]), ca.fmin(ca.fmax(a_r, lower[2]), upper[2]))
    stage = h * (ca.bilin(cost.state, z[:4], z[:4]) + ca.bilin(cost.effort, u - rest, u - rest))
    step = ca.Function("step", [z, u], [z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), stage])

    # in the order that fatrop wants: (z0, u0, z1, u1, …, zN), and the start as a constraint of the first stage
    now = ca.SX.sym("z0", n)
    free, low, high, equal, total = [now], [-np.inf] * n, [np.inf] * n, [], 0
    for i in range(steps):
        u, following = ca.SX.sym(f"u{i}", 3), ca.SX.sym(f"z{i + 1}", n)
        reached, paid = step(now, u)
        total = total + paid
        equal += [following - reached, *([now - start_at] if i == 0 else [])]
        free += [u, following]
        low += [*lower, *[-np.inf] * n]
        high += [*upper, *[np.inf] * n]
        now = following
    total = total + ca.bilin(cost.terminal, now[:4], now[:4])
    program = {"x": ca.vertcat(*free), "p": start_at, "f": total, "g": ca.vertcat(*equal)}
    quiet = {"print_time": False, "error_on_fail": False}
    quiet |= {"ipopt.print_level": 0, "ipopt.sb": "yes"} if name == "ipopt" else {}
    if name == "fatrop":
        quiet |= {"structure_detection": "auto", "equality": [True] * (n * (steps + 1)), "fatrop.print_level": 0}
    solve = ca.nlpsol("solve", name, program, {**quiet, **(options or {})})
    low, high = np.array(low), np.array(high)
    here, first = start_at, [start_at]
    inputs = ca.substitute(rest, z, start_at) if n == 5 else rest
    for _ in range(steps):
        here = step(here, inputs)[0]
        first += [inputs, here]
    guess = ca.Function("guess", [start_at], [ca.vertcat(*first)])

    def call(x: np.ndarray, theta: float):
        start = np.append(x, theta)[:n]
        found = solve(x0=guess(start), p=start, lbx=low, ubx=high, lbg=0, ubg=0)
        inputs = np.array(found["x"]).ravel()[n:].reshape(steps, 3 + n)[:, :3]
        return float(found["f"]), inputs, bool(solve.stats()["success"])

    return call


def _from(profile: Profile, theta: float) -> list[float]:
    """The coefficients of the piece at θ, ascending powers of what is beyond θ."""
    piece = int(np.searchsorted(profile.breaks, theta, side="right")) - 1
    shifted = np.polynomial.Polynomial([theta - profile.breaks[piece], 1.0])
    return list(np.polynomial.Polynomial(profile.coefficients[piece])(shifted).coef)


def solver_of(problem: Problem, name: str = "ipopt"):
    """The problem's numbers, put into `solver`."""
    begin, omega, speed, since = [], [], [], 0.0
    for segment in problem.path.curve:
        for b in np.union1d(segment.turn_rate.breaks, segment.speed.breaks)[:-1]:
            begin.append(since + b)
            omega.append(_from(segment.turn_rate, b))
            speed.append(_from(segment.speed, b))
        since += segment.duration
    order = max(map(len, omega + speed))
    omega, speed = ([[*c, *[0.0] * (order - len(c))] for c in table] for table in (omega, speed))
    cost = Cost(*(np.asarray(matrix) for matrix in weights_of(problem)))
    lower, upper = ([getattr(interval, side) for interval in problem.inputs] for side in ("lower", "upper"))
    return solver(Reference(begin, omega, speed, since), cost, lower, upper, problem.vehicle.wheelbase, name=name)
