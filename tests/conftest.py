"""Strict numerics and run-time checked shapes for every test; a result made by hand."""

import os
import pkgutil
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from hypothesis import settings
from jaxtyping import install_import_hook


# Before the package is imported. Not of `cfcheck`: it has no arrays, and millions of small calls on exact numbers.
# Looking at their types as well takes ten times as long as the proof.
ROOMS = [module.name for module in pkgutil.iter_modules([str(Path(__file__).parents[1] / "cfjax")])]
install_import_hook([f"cfjax.{room}" for room in ROOMS], "beartype.beartype")

from cfjax.train import prepare_environment  # noqa: E402


prepare_environment()  # commands and tests compile the same programs: what one has compiled is there for the others

import jax  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

from cfjax.funnel import Funnel, template_named  # noqa: E402
from cfjax.problem import Problem  # noqa: E402
from cfjax.result import ClosedLoop, Result, SegmentResult  # noqa: E402
from cfjax.verdict import Verdict  # noqa: E402


if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHROMIUM = shutil.which("chromium")
FLAGS = (
    *("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--no-first-run"),
)

settings.register_profile("campaign", max_examples=10_000)  # pytest --hypothesis-profile=campaign FILE: an hour

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture
def hand_made() -> Callable[..., Result]:
    """An inconclusive result with a funnel that nobody searched for: (problem, template, margin, **changes)."""

    def make(problem: Problem, template: str = "contracting", margin: float | None = None, **changes: object) -> Result:
        shape = np.diag([6.0, 5.0, 4.5, 7.0, 5.5, 6.5][: problem.dimension]) + 0.1
        rate = 0.0 if problem.path.tube else 0.01
        segments = tuple(
            SegmentResult(
                Funnel(template_named(template), shape, rate, s.duration, 0.9),
                1 / 3,
                margin,
                margin_per_metre=margin if problem.path.tube else None,
            )
            for s in problem.path.segments
        )
        return Result(
            verdict=Verdict.INCONCLUSIVE,
            message="made by hand",
            problem=problem,
            segments=segments,
            closed_loop=ClosedLoop(10, 0, 0, 0, 0.75, (1.5, 2.5)),
            seconds={"learn": 1.0, "certify": 2.0, "total": 3.0},
            iterations=2,
            history=(
                {"falsified": 0.25, "certified": 0.0, "counterexamples": 3},
                {"falsified": 1 / 3, "certified": 0.0, "counterexamples": 0},
            ),
        ).replace(**changes)

    return make


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """A file of points x + iy and, if given, speeds."""

    def make(points: np.ndarray, speed: np.ndarray | None = None, header: str | None = None) -> Path:
        file = tmp_path / "points.csv"
        columns = [points.real, points.imag, *([] if speed is None else [speed])]
        lines = [",".join(repr(float(value)) for value in row) for row in zip(*columns, strict=True)]
        file.write_text("\n".join([*([header] if header else []), *lines]) + "\n")
        return file

    return make


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    from playwright.sync_api import sync_playwright

    if CHROMIUM is None and not os.environ.get("CI"):
        pytest.skip("no browser: install chromium")
    assert CHROMIUM, "no browser: install chromium"
    with sync_playwright() as playwright:
        own = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield own
        own.close()
