"""The plan on a command line, and as the path of a run."""

import json
import math
from pathlib import Path

import pytest
from omegaconf import OmegaConf

import cfjax
from cfcheck import Outcome, check_document
from cfcheck.reader import read_json
from cfjax import InputError, Verdict
from cfjax.conf import config_of, preset, problem_of, yaml_of
from cfjax.job import question_of
from cfjax.planner.__main__ import main
from cfjax.synthesis import search
from tests.planner.scenes import BOUNDS, ENTRIES, scene


START, GOAL = [0, 0, -math.pi / 2], [7.2, 0, 0]


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    name = tmp_path / "scene.yaml"
    name.write_text(json.dumps({"obstacles": ENTRIES, "bounds": BOUNDS}))
    return name


def given(name: object) -> list[str]:
    return [f"path.map={name}", f"path.start={START}", f"path.goal={GOAL}"]


def arguments(name: Path, goal: list) -> list[str]:
    return [str(name), "--start", *map(str, START), "--goal", *map(str, goal)]


def test_the_command_writes_proof_and_picture(
    map_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    proof, picture = tmp_path / "plan.json", tmp_path / "plan.png"
    assert main([*arguments(map_file, GOAL), "--certificate", str(proof), "--picture", str(picture)]) == 0
    assert capsys.readouterr().out.startswith("plan in scene.yaml: ")
    assert check_document(read_json(proof)).outcome is Outcome.PROVEN
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_the_command_says_in_one_line_what_is_wrong(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, goal, message in ((map_file, [9, 0, 0], "1 m outside"), (map_file.parent / "no.yaml", GOAL, "No such")):
        assert main(arguments(name, goal)) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ") and message in error and error.count("\n") == 1


def test_a_run_along_a_plan_is_certified_and_holds_its_map(map_file: Path) -> None:
    """In tubes that hold its I, wider than the narrowest; its configuration needs the file no longer."""
    node = OmegaConf.structured(preset("plan", given(map_file.name)))
    config, problem, options = question_of(node, map_file.parent)
    assert problem.obstacles == scene().obstacles
    result = search(problem, options)
    assert result.verdict is Verdict.CERTIFIED and result.document is not None
    report = check_document(result.document)
    assert report.outcome is Outcome.PROVEN and "clear of 8 obstacles" in report.message
    map_file.unlink()
    assert problem_of(config_of(yaml_of(config))) == problem


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (given("none.yaml"), r"none\.yaml: .* cannot be read"),
        ([*given("{obstacles: []}"), "path.start=[1,2]"], r"start: expected a pose \[x, y, heading\]"),
        (given("{walls: []}"), "path.map: expected the name of a file, or obstacles and bounds"),
        ([*given("{obstacles: []}"), "sets.obstacles=[{disc: [9, 9, 1]}]"], "sets.obstacles: expected none beside"),
        ([*given("{obstacles: []}"), "sets.inlet=0.9", "sets.goal=0.9"], "sets.inlet: expected an I that a tube"),
    ],
)
def test_configurations_that_make_no_plan(overrides: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        problem_of(preset("plan", overrides))


def test_keys_that_are_missing_are_named() -> None:
    with pytest.raises(InputError, match=r"expected a value for path\.goal, path\.map, path\.start"):
        preset("plan")


def test_the_picture_shows_the_whole_map() -> None:
    found = cfjax.plan(scene(), START, GOAL)
    axes = found.plot().axes[0]
    assert axes.get_xlim()[0] < BOUNDS[0] and axes.get_xlim()[1] > BOUNDS[2]
    names = [text.get_text() for text in found.plot().legends[0].get_texts()]
    assert names == [
        "obstacle",
        "reach of the body",
        "tube",
        "reference",
        "funnel's start",
        "funnel's end",
        "closest approach",
    ]
    with pytest.raises(InputError, match="panel: expected one of plane"):
        cfjax.plot(found, "values")
