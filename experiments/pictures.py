"""The pictures of README and docs: certified runs of a few presets, drawn as funnel.png is.

    python experiments/pictures.py [--output FOLDER] [--only NAME]

Each run takes up to two minutes. Files have a palette of 256 colours, which nobody sees and which makes them small.
"""

import argparse
from pathlib import Path

from PIL import Image

from cfjax.conf import options_of, preset, problem_of
from cfjax.report.plot import save_picture
from cfjax.result import Result
from cfjax.synthesis import synthesize
from cfjax.verdict import Verdict


# file: preset, overrides
PICTURES: dict[str, tuple[str, tuple[str, ...]]] = {
    "hero": ("circle", ()),
    "oval": ("oval", ()),
    "obstacle_tight": ("obstacle_tight", ()),
}
LARGEST = 300_000  # bytes


def save_small(result: Result, path: Path) -> None:
    """The picture of a certified result in at most 300 kB.

    Raises:
        ValueError: it is not certified, or larger.
    """
    if result.verdict is not Verdict.CERTIFIED:
        raise ValueError(f"{path}: expected a certified run, got {result.verdict.value}: {result.message}")
    save_picture(result, path)
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    small.save(path, optimize=True)
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path}: expected at most {LARGEST} bytes, got {path.stat().st_size}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("docs/images"), help="folder of the pictures")
    parser.add_argument("--only", choices=PICTURES, help="one of them")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name, (path, overrides) in PICTURES.items():
        if arguments.only in (None, name):
            config = preset(path, ["cars=1000", *overrides])
            save_small(synthesize(problem_of(config), options_of(config)), arguments.output / f"{name}.png")
            print(arguments.output / f"{name}.png", flush=True)


if __name__ == "__main__":
    main()
