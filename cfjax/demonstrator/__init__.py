"""The demonstrator: what a controller that looks ahead would do, for a batch of deviations; never trusted."""

from cfjax.demonstrator.demonstrator import Demonstration, Horizon, demonstrate, horizon_of
from cfjax.demonstrator.task import Weights, weights_of


__all__ = ["Demonstration", "Horizon", "Weights", "demonstrate", "horizon_of", "weights_of"]
