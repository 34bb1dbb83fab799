"""The pictures of README and docs: certified runs of a few presets, drawn as funnel.png is, and what a funnel is.

    python experiments/pictures.py [--output FOLDER] [--only NAME]

Each run takes up to two minutes. Files have a palette of 256 colours, which nobody sees and which makes them small.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure
from PIL import Image

from cfjax.conf import options_of, preset, problem_of
from cfjax.planner import Map, plan
from cfjax.report.plot import plot
from cfjax.report.style import STYLE
from cfjax.result import Result
from cfjax.synthesis import synthesize
from cfjax.verdict import Verdict
from experiments.funnel_page import DRAWN
from experiments.random_maps import random_scene


# file: preset, overrides
PICTURES: dict[str, tuple[str, tuple[str, ...]]] = {
    "hero": ("circle", ()),
    "oval": ("oval", ()),
    "obstacle_tight": ("obstacle_tight", ()),
}
PAGE = "circle"  # the preset that docs/funnel.md is about
MAP = 5  # the seed of the map of docs/maps.md
LARGEST = 300_000  # bytes


def save_small(result: Result, path: Path, drawn: Callable[[Result], Figure] = plot) -> None:
    """The picture of a certified result in at most 300 kB.

    Raises:
        ValueError: it is not certified, or larger.
    """
    if result.verdict is not Verdict.CERTIFIED:
        raise ValueError(f"{path}: expected a certified run, got {result.verdict.value}: {result.message}")
    save_figure(drawn(result), path)


def save_figure(figure: Figure, path: Path) -> None:
    """A picture in at most 300 kB; raises ValueError where it is larger."""
    with matplotlib.rc_context(STYLE):
        figure.savefig(path, metadata={"Software": None})
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    small.save(path, optimize=True)
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path}: expected at most {LARGEST} bytes, got {path.stat().st_size}")
    print(path, flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("docs/images"), help="folder of the pictures")
    parser.add_argument(
        "--only", choices=[*PICTURES, "plan", "funnel"], help="one of them; funnel: those of docs/funnel.md"
    )
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name, (path, overrides) in PICTURES.items():
        if arguments.only in (None, name):
            save_small(_run(path, overrides), arguments.output / f"{name}.png")
    if arguments.only in (None, "plan"):
        scene = random_scene(MAP, 60)
        found = plan(Map(scene.entries, scene.bounds, "map"), scene.start, scene.goal)
        save_figure(found.plot(), arguments.output / "plan.png")
    if arguments.only in (None, "funnel"):
        result = _run(PAGE, ())
        for name, drawn in DRAWN.items():
            save_small(result, arguments.output / f"{name}.png", drawn)


def _run(path: str, overrides: tuple[str, ...]) -> Result:
    config = preset(path, ["cars=1000", *overrides])
    return synthesize(problem_of(config), options_of(config))


if __name__ == "__main__":
    main()
