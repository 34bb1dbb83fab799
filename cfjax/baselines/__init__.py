"""Controllers that users know, as the sampled loop takes them: what funnels are compared with. Nothing is proven here.

Pure pursuit and Stanley steer by geometry, regulate the speed of the nearest point of the path, and keep no time. The
tracker by model predictive control solves the demonstrator's optimal-control problem at every sample.
"""

from cfjax.baselines.mpc import Mpc, mpc
from cfjax.baselines.pure_pursuit import PurePursuit
from cfjax.baselines.stanley import Stanley


__all__ = ["Mpc", "PurePursuit", "Stanley", "mpc"]
