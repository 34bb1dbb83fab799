"""What a vehicle says of its states: names and units."""

from typing import ClassVar

from cfjax.problem import KinematicBicycle
from experiments.vehicles.dynamic_single_track import DynamicSingleTrack
from experiments.vehicles.omnidirectional import Omnidirectional
from experiments.vehicles.steered_car import SteeredCar


class Heavy(KinematicBicycle):
    """The car with nothing changed but its name."""

    name: ClassVar[str] = "heavy"


class Drifting(KinematicBicycle):
    """A car with one more state, of which no unit is said."""

    internal_names: ClassVar[tuple[str, ...]] = ("v", "drift")


def test_states_and_their_rates_have_units() -> None:
    pose, rates = ("rad", "m", "m"), ("rad/s", "m/s", "m/s")
    for vehicle, units, rate_units in (
        (KinematicBicycle(), ("m/s",), ("m/s²",)),
        (Heavy(), ("m/s",), ("m/s²",)),
        (DynamicSingleTrack(), ("m/s", "m/s", "rad/s"), ("m/s²", "m/s²", "rad/s²")),
        (SteeredCar(), ("m/s", ""), ("m/s²", "1/s")),
        (Drifting(), ("", ""), ("1/s", "1/s")),
        (Omnidirectional(), (), ()),
    ):
        assert vehicle.state_units == (*pose, *units)
        assert vehicle.rate_units == (*rates, *rate_units)
        assert len(vehicle.state_names) == len(vehicle.state_units)
