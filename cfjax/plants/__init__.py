"""What the controller drives, and through what it sees: plants and sensors, for experiments; nothing is proven here."""

from cfjax.plants.commonroad import CommonRoad
from cfjax.plants.host import HostPlant
from cfjax.plants.model import Disturbed, Model
from cfjax.plants.plant import Plant, Scene
from cfjax.plants.sensor import Measurement, Sensor, perfect
from cfjax.plants.single_track import SingleTrack, single_track
from cfjax.plants.slipx_car import SlipX
from cfjax.plants.spec import PLANTS, plant_named, sensor_named


__all__ = [
    "PLANTS",
    "CommonRoad",
    "Disturbed",
    "HostPlant",
    "Measurement",
    "Model",
    "Plant",
    "Scene",
    "Sensor",
    "SingleTrack",
    "SlipX",
    "perfect",
    "plant_named",
    "sensor_named",
    "single_track",
]
