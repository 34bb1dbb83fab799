"""Ways through the files, as docs/architecture.md describes them: the calls come in this order."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import numpy as np

from cfjax import Funnel, Problem, circle, waypoints
from cfjax.control.law import law_numbers
from cfjax.control.min_norm import MinNorm
from cfjax.exact import exact_course, write_path
from cfjax.funnel import template_named


ROOT = Path(__file__).parents[1]
PACKAGES = ("cfjax", "cfcheck")


def stops(title: str) -> list[str]:
    """The stops of one way, `file:name`, from the row of the table that begins with `title`."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    (row,) = (line for line in text.splitlines() if line.startswith(f"| {title} |"))
    way, file = [], ""
    for word in re.findall(r"`([^`]+)`", row):
        if word.endswith(".py"):
            file = word if word.startswith(PACKAGES) else f"cfjax/{word}"
        else:
            way.append(f"{file}:{word}")
    return way


def visited(work: Callable[[], object]) -> list[str]:
    """The package's functions that `work` calls in this thread, `file:name`, in the order of their first calls."""
    seen: dict[str, None] = {}

    def note(frame: FrameType, event: str, _: object) -> None:
        file = frame.f_code.co_filename
        if event == "call" and file.startswith(tuple(f"{ROOT / package}/" for package in PACKAGES)):
            seen.setdefault(f"{file[len(str(ROOT)) + 1 :]}:{frame.f_code.co_qualname}")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(before)
    return list(seen)


def require_in_order(title: str, calls: list[str]) -> None:
    way = stops(title)
    assert len(way) > 4
    assert not [stop for stop in way if stop not in calls]
    assert sorted(way, key=calls.index) == way


def steady() -> Problem:
    return Problem(circle(radius=1.5, speed=1.0), inlet=0.5, goal=0.5, safe=[1.0, 1.0, 1.0, 3.0])


def test_a_profile_becomes_the_exact_document() -> None:
    path = waypoints([(0.0, 0.0), (4.0, 0.0), (8.0, 1.0), (12.0, 1.0)], speed=2.0)
    calls = visited(lambda: write_path(path, exact_course(path).pieces, closed=False))
    require_in_order("a path's profile to the exact document", calls)


def test_a_funnel_becomes_its_law() -> None:
    problem = steady()

    def drive() -> object:
        funnel = Funnel(template_named("contracting"), 2 * np.eye(4), 0.0, problem.path.duration)
        numbers, point = law_numbers(problem, funnel, 0.3), problem.path.curve[0].point(0.0)
        return MinNorm()(problem.vehicle, funnel.template, numbers, point, 0.0, (0.1, 0.1, 0.1, 0.1))

    require_in_order("a funnel to its law", visited(drive))
