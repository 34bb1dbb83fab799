"""SlipX: a 1/10-scale racer that nobody here wrote.

Package slipx, Apache-2.0 (github.com/ibrahimsel/slipx); its double track (13 states): four contact patches with load
transfer, tyres with a peak, relaxation and combined slip, a drivetrain with current limits and battery, rolling
resistance, a second-order steering servo with rate limit. Its parameters are marked provisional: no car was measured.
Compiled: about 10 ms per car and second on one core.
"""

from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from cfjax.plants.host import HostPlant, extra, fits
from cfjax.plants.plant import bicycle
from cfjax.problem import Vehicle


STEP = 1e-3  # s, as in its own examples


class SlipX(HostPlant):
    """The package's reference car: wheelbase 0.32 m, steering up to 0.4 rad; its own state is a `VehicleState`.

    Raises:
        InputError: where the package is missing, or the run is about a car of another size.
    """

    name: ClassVar[str] = "slipx"

    def __init__(self, vehicle: Vehicle) -> None:
        wheelbase = bicycle(vehicle, self.name).wheelbase
        self._package = extra("slipx", "slipx")
        self._car = self._package.load_reference_car().params
        fits(wheelbase, self._car.wheelbase, self.name)
        self._model = self._package.VehicleModel.create(self._package.Tier.L2_DoubleTrack, self._car)

    def start(self, states: Float[np.ndarray, "k n"]) -> list[Any]:
        found = []
        for alpha, x, y, v in states:
            own = self._package.VehicleState()
            # its heading is counted from +x, and its place is the centre of mass
            own.yaw = alpha + np.pi / 2
            own.pos.x, own.pos.y = x - self._car.lr * np.sin(alpha), y + self._car.lr * np.cos(alpha)
            own.vel_body.x = v
            found.append(own)
        return found

    def hold(self, own: Any, command: Float[np.ndarray, " m"], duration: float) -> Any:
        count = max(1, int(np.ceil(duration / STEP - 1e-9)))
        steer, thrust = map(float, command)
        drive = self._package.DriveInput(steer_cmd=steer, accel_cmd=thrust)
        own = own.copy()
        for _ in range(count):
            self._model.step(own, drive, duration / count)
        return own

    def observe(self, own: Any) -> Float[np.ndarray, " n"]:
        alpha, rear = own.yaw - np.pi / 2, self._car.lr
        return np.array([alpha, own.pos.x + rear * np.sin(alpha), own.pos.y - rear * np.cos(alpha), own.vx])
