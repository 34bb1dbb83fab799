"""Path tracking as in the papers on neural Lyapunov functions: a region of attraction in (d_e, θ_e), beside a circle.

v = 2 m/s, wheelbase 1 m, a circle of 10 m, |tan δ| at most 0.84 or 0.5. Printed are
ḋ = v sin θ and θ̇ = v tan δ/L − cos θ/(R/v − sin θ); beside a circle it is θ̇ = v tan δ/L − v cos θ/(R − d).
The printed system is stated in another time, dτ = dt/(R/v − sin θ), which leaves its trajectories as they are and its
rates polynomials in sin θ and cos θ; R/v − sin θ is at least 4.
"""

import math

import numpy as np
from scipy.optimize import minimize

from experiments.benchmarks.region import Rates, System


LEVELS = np.geomspace(0.01, 1.0, 12)
ANGLES = np.linspace(0.0, 2 * math.pi, 361)
WIDEST_OFFSET, WIDEST_HEADING = {False: 9.3, True: 9.9}, 5.2  # m, below the circle's radius; rad


def system(limit: str, printed: bool) -> System:
    """With |tan δ| up to a limit, a decimal."""
    rates = Rates()
    offset, heading, steering = rates("input", "d_e"), rates("input", "theta_e"), rates("input", "input:tan_delta")
    two, sine, cosine = rates.number("2"), rates("sin", heading), rates("cos", heading)
    drift, turn = rates("mul", two, sine), rates("mul", two, steering)
    if printed:
        rest = rates("sub", rates.number("5"), sine)
        outputs = rates("mul", drift, rest), rates("sub", rates("mul", turn, rest), cosine)
    else:
        rest = rates("sub", rates.number("10"), offset)
        outputs = drift, rates("sub", turn, rates("mul", rates("mul", two, cosine), rates("inv", rest)))
    name = "path_tracking_as_printed" if printed else "path_tracking"
    return System(name, ("d_e", "theta_e"), rates, outputs, {"tan_delta": (f"-{limit}", limit)})


def candidate(limit: float, printed: bool, area: float, starts: int = 4) -> np.ndarray:
    """C of an ellipse of this area (m rad) on which V falls fastest by the numbers: shape (2, 2), nothing proven."""
    found = []
    for seed in range(starts):
        drawn = np.random.default_rng(seed)
        start = [math.log(drawn.uniform(5, 9)), drawn.uniform(-3, -1)]
        found.append(minimize(_cost, start, (limit, printed, area), method="Nelder-Mead", options={"maxfev": 300}))
    root = _root(min(found, key=lambda each: each.fun).x, area)
    return np.linalg.inv(root @ root.T)


def _root(free: np.ndarray, area: float) -> np.ndarray:
    """M, lower triangular, of the ellipse M (unit disc)."""
    wide = math.exp(free[0])
    return np.array([[wide, 0.0], [free[1], area / math.pi / wide]])


def _cost(free: np.ndarray, limit: float, printed: bool, area: float) -> float:
    """The largest rate of log V with the best steering, and what it costs to leave the ranges."""
    root = _root(free, area)
    circle = root @ np.array([np.cos(ANGLES), np.sin(ANGLES)])
    offset, heading = np.sqrt(LEVELS)[:, None, None].transpose(1, 0, 2) * circle[:, None, :]
    slope, across = 2 * np.einsum("ij,jkl->ikl", np.linalg.inv(root @ root.T), np.array([offset, heading]))
    rest = np.minimum(offset, 9.7) - 10
    curve = np.cos(heading) / (5 - np.sin(heading)) if printed else -2 * np.cos(heading) / rest
    rate = slope * 2 * np.sin(heading) - across * curve - 2 * limit * np.abs(across)
    wide, far = root[0, 0] - WIDEST_OFFSET[printed], math.hypot(*root[1]) - WIDEST_HEADING
    return float((rate / LEVELS[:, None]).max()) + 50 * max(0.0, wide) + 5 * max(0.0, far)
