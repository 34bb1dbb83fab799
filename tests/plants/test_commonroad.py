"""CommonRoad's multi-body car as a plant: its frame and its servo, and steps that are fine enough."""

import numpy as np
import pytest

from cfjax.plants import commonroad
from cfjax.problem import KinematicBicycle


pytest.importorskip("vehiclemodels")
CAR = KinematicBicycle(wheelbase=2.58)
START = np.array([0.3, 1.0, -2.0, 5.0])
PERIOD = 0.02  # s


def driven(plant: commonroad.CommonRoad, command: tuple[float, float], periods: int) -> np.ndarray:
    """States at the ends of the periods, the start first."""
    (own,) = plant.start(START[None])
    seen = [plant.observe(own)]
    for _ in range(periods):
        own = plant.hold(own, np.array(command), PERIOD)
        seen.append(plant.observe(own))
    return np.array(seen)


def test_it_starts_where_it_is_put_and_drives_ahead() -> None:
    way = driven(commonroad.CommonRoad(CAR), (0.0, 0.0), 10)
    np.testing.assert_allclose(way[0], START, rtol=0, atol=1e-12)
    ahead = START[1:3] + 10 * PERIOD * START[3] * np.array([-np.sin(START[0]), np.cos(START[0])])
    np.testing.assert_allclose(way[-1, 1:3], ahead, atol=5e-3)


def test_it_turns_left_and_speeds_up_as_it_is_told() -> None:
    left, right = (driven(commonroad.CommonRoad(CAR), (angle, 1.0), 25) for angle in (0.1, -0.1))
    gone = 25 * PERIOD
    for way, sign in ((left, 1), (right, -1)):
        assert way[-1, 3] == pytest.approx(START[3] + gone, abs=0.1)
        turned = sign * (way[-1, 0] - START[0])
        # less than the bicycle, whose wheels turn at once; its own turn at the rate of 0.4 rad/s
        assert 0.2 < turned / (0.1 * START[3] / CAR.wheelbase * gone) < 1.0


def test_finer_steps_drive_the_same_way(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = commonroad.CommonRoad(CAR)
    usual = driven(plant, (0.2, 2.0), 10)
    monkeypatch.setattr(commonroad, "STEP", commonroad.STEP / 4)
    np.testing.assert_allclose(driven(plant, (0.2, 2.0), 10), usual, rtol=0, atol=1e-5)
