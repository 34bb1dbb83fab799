"""Points x + iy in m, made here, of paths as they come in files."""

import numpy as np


def racing_line(seed: int = 5, count: int = 100) -> np.ndarray:
    """A lap of more than 200 m with bends of different radii; the first point is repeated at the end."""
    draw = np.random.default_rng(seed)
    u = 2 * np.pi * np.arange(count + 1) / count
    radius = 32 + sum(4 / k * draw.uniform(-1, 1) * np.cos(k * u + draw.uniform(0, 6)) for k in range(2, 8))
    line = (1.3 * radius * np.cos(u) + 0.8j * radius * np.sin(u)) * np.exp(0.4j)
    line[-1] = line[0]
    return line


def eight(count: int = 60) -> np.ndarray:
    u = 2 * np.pi * np.arange(count + 1) / count
    line = 2.5 * np.cos(u) / (1 - 1j * np.sin(u))
    line[-1] = line[0]
    return line


def slalom(count: int = 50) -> np.ndarray:
    x = np.linspace(0, 12, count)
    return x + 0.4j * np.sin(np.pi / 2 * x)
