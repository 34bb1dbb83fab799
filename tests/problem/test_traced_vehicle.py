"""A vehicle as JAX traces it: the same dynamics, found again in another process, never by outdated code."""

import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cfjax.identity import identity
from cfjax.problem import KinematicBicycle, ReferencePoint, Vehicle, affine_deviation, deviation_rate
from cfjax.problem.traced_vehicle import traced_vehicle
from experiments.vehicles.dynamic_single_track import DynamicSingleTrack
from experiments.vehicles.steered_car import SteeredCar
from experiments.vehicles.unicycle import Unicycle


OWN = """
from dataclasses import dataclass
from cfjax.problem import KinematicBicycle, Twist
from tyres import pull

@dataclass(frozen=True)
class Own(KinematicBicycle):
    def twist(self, internal, inputs):
        (v,), (w, _) = internal, inputs
        return Twist(turn=pull(v) * w, lateral=0.0, forward=v)
"""
TOLD = """
import sys
sys.path.insert(0, sys.argv[1])
import cars
from cfjax.identity import identity
from cfjax.problem.traced_vehicle import traced_vehicle
import cfjax.problem.deviation
print(identity(traced_vehicle(cars.Own())))
"""


@pytest.mark.parametrize("vehicle", [KinematicBicycle(), Unicycle(), SteeredCar(), DynamicSingleTrack()])
def test_it_moves_as_the_vehicle_does(vehicle: Vehicle) -> None:
    """One scalar at a time, in batches, and to first order."""
    rng = np.random.default_rng(0)
    x = rng.uniform(0.1, 0.3, size=(len(vehicle.state_names), 7))
    u = rng.uniform(0.1, 0.3, size=(1 + len(vehicle.input_names), 7))
    batch, point = ReferencePoint(*rng.uniform(0.8, 1.2, size=(4, 7))), ReferencePoint(1.0, 1.2, 0.3, 0.4)
    own = traced_vehicle(vehicle)
    for here in (tuple(x), tuple(x[:, 0])):
        there = (tuple(u), batch) if here[0].ndim else (tuple(u[:, 0]), point)
        expected, found = (jnp.stack(deviation_rate(each, here, *there)) for each in (vehicle, own))
        np.testing.assert_allclose(found, expected, rtol=1e-14)
    slopes = (jax.jacobian(lambda at, each=each: affine_deviation(each, at, point))(x[:, 0]) for each in (vehicle, own))
    for expected, found in zip(*slopes, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


def test_equal_vehicles_are_one() -> None:
    assert traced_vehicle(SteeredCar()) is traced_vehicle(SteeredCar())
    assert identity(traced_vehicle(SteeredCar())) != identity(traced_vehicle(SteeredCar(max_thrust=5.0)))
    assert identity(traced_vehicle(SteeredCar())) != identity(traced_vehicle(SteeredCar(wheelbase=0.35)))


def told(folder: Path, pull: str) -> str:
    """What another process says of a class whose module imports another one of the user's."""
    (folder / "cars.py").write_text(OWN)
    (folder / "tyres.py").write_text(f"def pull(v):\n    return {pull}\n")
    command = [sys.executable, "-B", "-c", TOLD, str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_what_a_class_imports_counts(tmp_path: Path) -> None:
    first = told(tmp_path, "v / 0.34")
    assert "TracedVehicle" in first
    assert told(tmp_path, "v / 0.34") == first
    assert told(tmp_path, "v / 0.35") != first
