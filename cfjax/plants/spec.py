"""Plants and sensors by a few words, as the command line takes them.

    NAME or NAME:key=value,key=value …          a plant:  single_track:lag=0.1,stiffness=0.7
    words and key=value, separated by commas    noise:    mocap,delay=0.02,jitter=0.01

All numbers in SI units.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cfjax import coerce
from cfjax.errors import InputError, renamed
from cfjax.plants.commonroad import CommonRoad
from cfjax.plants.host import HostPlant
from cfjax.plants.model import KINDS, Disturbed, Kind, Model
from cfjax.plants.plant import Plant, bicycle
from cfjax.plants.sensor import Sensor
from cfjax.plants.single_track import single_track
from cfjax.plants.slipx_car import SlipX
from cfjax.problem import KinematicBicycle, Vehicle


Numbers = dict[str, float]
POSE_KEYS = ("heading", "position", "speed")  # rad, m, and the unit of every internal state
BIAS_KEYS = ("bias_heading", "bias_x", "bias_y", "bias_speed")
WORDS: dict[str, Numbers] = {
    "none": {},
    # an optical system in a hall: a millimetre, a sixth of a degree, speed by differences
    "mocap": {"heading": 3e-3, "position": 1e-3, "speed": 0.02},
    # poses over a wireless network: late, irregular, and sometimes not at all
    "wifi": {"delay": 0.02, "jitter": 0.02, "loss": 0.05},
}
RENAMED = {"drop": "loss"}  # keys of noise, by their former names
NOISE_KEYS = (*POSE_KEYS, *BIAS_KEYS, "delay", "jitter", "loss")


def sensor_named(text: str, vehicle: Vehicle) -> Sensor:
    """A sensor; later words override earlier ones.

    Raises:
        InputError: says which words and keys there are.
    """
    numbers: Numbers = {}
    coerce.objects(vehicle=(vehicle, Vehicle))
    for part in filter(None, (part.strip() for part in coerce.text("noise", text).split(","))):
        if "=" in part:
            key, value = _pair("noise", part)
            if key in RENAMED:
                renamed(f"noise: {key}", RENAMED[key])
                key = RENAMED[key]
            if key not in NOISE_KEYS:
                raise InputError(f"noise: expected one of {', '.join(WORDS)}, or a key of {_listed()}; got {part}")
            numbers[key] = value
        elif part in WORDS:
            numbers |= WORDS[part]
        else:
            raise InputError(f"noise: expected one of {', '.join(WORDS)}, or key=value with {_listed()}; got {part}")
    heading, position, speed = (numbers.get(key, 0.0) for key in POSE_KEYS)
    biases = [numbers.get(key, 0.0) for key in BIAS_KEYS]
    internal = len(vehicle.internal_names)
    return Sensor(
        np.array([heading, position, position, *(speed,) * internal]),
        np.array([*biases[:3], *(biases[3],) * internal]),
        **{key: numbers.get(key, 0.0) for key in ("delay", "jitter", "loss")},
    )


def _listed() -> str:
    return ", ".join(NOISE_KEYS)


def _model(vehicle: Vehicle, numbers: Numbers, words: list[str]) -> Plant:
    return Model(_other(vehicle, numbers))


def _other(vehicle: Vehicle, numbers: Numbers) -> Vehicle:
    """The vehicle with another wheelbase, where one is asked for: a mismatch. Limits are the controller's affair."""
    if "wheelbase" not in numbers:
        return vehicle
    own = bicycle(vehicle, "a plant with a wheelbase")
    return KinematicBicycle(numbers["wheelbase"], own.max_tan_steering, own.max_thrust)


def _disturbed(vehicle: Vehicle, numbers: Numbers, words: list[str]) -> Plant:
    names = vehicle.state_names
    bound = [numbers.get(name, numbers.get("bound", 0.0)) for name in names]
    if not any(bound):
        raise InputError(f"plant: expected a bound of disturbed, such as disturbed:x=0.1, of {', '.join(names)}")
    hold = numbers.get("hold", 0.1)
    if not hold > 0:
        raise InputError(f"plant: expected a positive hold of disturbed, got {hold:g}")
    return Disturbed(vehicle, np.array(bound), _kind(words), hold)


def _kind(words: list[str]) -> Kind:
    named: list[Kind] = [kind for kind in KINDS if kind in words]
    return named[-1] if named else "random"


def _single_track(vehicle: Vehicle, numbers: Numbers, words: list[str]) -> Plant:
    given: dict[str, Any] = {**numbers}
    return single_track(bicycle(vehicle, "single_track").wheelbase, **given)


def _commonroad(vehicle: Vehicle, numbers: Numbers, words: list[str]) -> HostPlant:
    return CommonRoad(vehicle, **numbers)


def _slipx(vehicle: Vehicle, numbers: Numbers, words: list[str]) -> HostPlant:
    return SlipX(vehicle)


Maker = Callable[[Vehicle, Numbers, list[str]], Plant | HostPlant]
PLANTS: dict[str, tuple[Maker, tuple[str, ...], tuple[str, ...]]] = {
    "model": (_model, ("wheelbase",), ()),
    "disturbed": (_disturbed, ("bound", "hold"), KINDS),  # and the states' names
    "single_track": (_single_track, ("stiffness", "lag", "rate", "friction", "mass", "inertia", "height"), ()),
    "commonroad": (_commonroad, ("lag",), ()),
    "slipx": (_slipx, (), ()),
}
"""Plants by name: what makes it, the keys that it takes, and words."""


def plant_named(text: str, vehicle: Vehicle) -> Plant | HostPlant:
    """A plant for a vehicle.

    Raises:
        InputError: says which plants there are, and which keys this one takes; or what to install for it.
    """
    coerce.objects(vehicle=(vehicle, Vehicle))
    name, _, rest = coerce.text("plant", text).partition(":")
    coerce.one_of("plant", name, PLANTS)
    make, keys, known = PLANTS[name]
    keys = (*keys, *vehicle.state_names) if name == "disturbed" else keys
    numbers: Numbers = {}
    words: list[str] = []
    for part in filter(None, (part.strip() for part in rest.split(","))):
        if "=" in part:
            key, value = _pair("plant", part)
            numbers[key] = value
        else:
            key = part
            words.append(part)
        if key not in (keys if "=" in part else known):
            offered = [*known, *(f"{key}=number" for key in keys)]
            raise InputError(f"plant: expected {name} with {', '.join(offered) or 'nothing more'}; got {part}")
    return make(vehicle, numbers, words)


def _pair(label: str, part: str) -> tuple[str, float]:
    key, _, value = part.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{label}: expected a finite number for {key.strip()}, got {value.strip() or 'nothing'}")
    return key.strip(), number
