"""CommonRoad's multi-body model (29 states): a passenger car that nobody here wrote.

Package commonroad-vehicle-models, BSD licence, M. Althoff and G. Würsching, "CommonRoad: Vehicle Models" (2020). Its
inputs are the rate of the steering angle, at most 0.4 rad/s, and the acceleration; the servo in front of it has a lag.
Pure Python: about 0.1 s per car and second on one core.
"""

import importlib
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from cfjax.errors import InputError
from cfjax.plants.host import HostPlant, extra, fits
from cfjax.plants.plant import bicycle
from cfjax.problem import Vehicle
from cfjax.problem.runge_kutta import runge_kutta


STEP = 2e-3  # s: wheels and tyre deflection are stiff


class CommonRoad(HostPlant):
    """Vehicle 2, a BMW 320i with a wheelbase of 2.58 m; its own state is a list of 29 numbers.

    Raises:
        InputError: where the package is missing, or the run is about a car of another size.
    """

    name: ClassVar[str] = "commonroad"

    def __init__(self, vehicle: Vehicle, lag: float = 0.1) -> None:
        wheelbase = bicycle(vehicle, self.name).wheelbase
        self._initial = extra("vehiclemodels.init_mb", "commonroad-vehicle-models").init_mb
        self._dynamics = importlib.import_module("vehiclemodels.vehicle_dynamics_mb").vehicle_dynamics_mb
        self._car = importlib.import_module("vehiclemodels.parameters_vehicle2").parameters_vehicle2()
        fits(wheelbase, self._car.a + self._car.b, self.name)
        if not lag > 0:
            raise InputError(f"plant: expected a positive lag, got {lag:g}")
        self.lag = lag

    def start(self, states: Float[np.ndarray, "k n"]) -> list[Any]:
        rear = self._car.b
        # its heading is counted from +x, and its place is the centre of mass
        return [
            np.array(
                self._initial(
                    [x - rear * np.sin(alpha), y + rear * np.cos(alpha), 0.0, v, alpha + np.pi / 2, 0.0, 0.0], self._car
                )
            )
            for alpha, x, y, v in states
        ]

    def hold(self, own: Any, command: Float[np.ndarray, " m"], duration: float) -> Any:
        count = max(1, int(np.ceil(duration / STEP - 1e-9)))
        h = duration / count
        wanted, thrust = map(float, command)

        def rate(z: np.ndarray) -> np.ndarray:
            return np.array(self._dynamics(z.tolist(), [(wanted - z[2]) / self.lag, thrust], self._car))

        for _ in range(count):
            own = runge_kutta(rate, own, h)
        return own

    def observe(self, own: Any) -> Float[np.ndarray, " n"]:
        alpha, rear = own[4] - np.pi / 2, self._car.b
        return np.array([alpha, own[0] + rear * np.sin(alpha), own[1] - rear * np.cos(alpha), own[3]])
