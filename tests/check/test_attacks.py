"""A short version of the campaign in `scripts/attack_certificates.py`: every attack, a few times."""

import importlib
import json
import os
import random
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from cfjax.problem import Disc, circle
from cfjax.tubes import chain_document, follow


SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture(scope="module")
def campaign() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SCRIPTS))
        return importlib.import_module("attack_certificates")


def run(folder: Path, texts: tuple[str, ...], *options: str) -> list[dict[str, Any]]:
    """The campaign's command, without the run-time types of the tests, which slow it down tenfold; its log."""
    script, log = SCRIPTS / "attack_certificates.py", folder / "log.jsonl"
    files = [folder / f"{index}.json" for index in range(len(texts))]
    for file, text in zip(files, texts, strict=True):
        file.write_text(text)
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script), *map(str, files), "--log", str(log), *options],
        capture_output=True,
        text=True,
        timeout=250,
        env={**os.environ, "PYTHONPATH": str(SCRIPTS.parent)},
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return [json.loads(line) for line in log.read_text().splitlines()]


@pytest.mark.slow
def test_nothing_false_is_accepted(
    campaign: ModuleType, tmp_path: Path, paper_text: str, contracting_text: str, tube_text: str, lap_text: str
) -> None:
    entries = run(tmp_path, (paper_text, contracting_text, tube_text, lap_text), "--count", "200", "--seed", "2")
    assert campaign.failures(entries) == []
    assert {entry["attack"] for entry in entries} == set(campaign.ATTACKS)
    assert sum(entry["outcome"] == "true, accepted" for entry in entries) > 5  # the truth is told apart
    assert "total" in campaign.table(entries)


def test_nothing_false_is_accepted_of_a_path_with_its_tubes(campaign: ModuleType, tmp_path: Path) -> None:
    text = json.dumps(chain_document(follow(circle(1.5, 1.2), closed=True)))
    assert campaign.is_true(json.loads(text)) == ""
    for only in ("leg changed", "model changed", "path changed"):
        entries = run(tmp_path, (text,), "--count", "8", "--seed", "1", "--only", only)
        assert campaign.failures(entries) == []
    first = "problem", "path", "pieces", 0
    for path, value, expected in (
        ((*first, "turn_rate", 0), "9", "closed"),
        ((*first, "speed", 0), "9/10", "speed"),
        ((*first, "duration"), "1/2", "closed"),
        (("problem", "vehicle", "parameters", "max_thrust"), "1/100", "vehicle"),
        (("problem", "sets", "inlet"), {"half_axes": ["1"] * 4}, "(a)"),
        (("problem", "sets", "goal"), {"half_axes": ["1/100"] * 4}, "(b)"),
        (("funnels", 0, "margin"), "9", "(d)"),
        (("funnels", 0, "margin_per_metre"), "9", "(d)"),
        (("funnels", 0, "margin_per_metre"), None, ""),  # a weaker claim, if none that the checker takes
    ):
        document = json.loads(text)
        holder = document
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value
        assert campaign.is_true(document) == expected


@pytest.mark.slow
def test_nothing_false_is_accepted_beside_obstacles(campaign: ModuleType, tmp_path: Path) -> None:
    pole = Disc(2.6, 0.0, 0.3)
    text = json.dumps(chain_document(follow(circle(1.5, 1.2), closed=True, obstacles=[pole], footprint=[[0.2, 0.1]])))
    document = json.loads(text)
    assert campaign.is_true(document) == ""
    document["problem"]["sets"]["obstacles"][0]["corners"] = [["2", "0"]]
    assert campaign.is_true(document) == "obstacle"
    entries = run(tmp_path, (text,), "--count", "24", "--seed", "3", "--only", "place changed")
    assert campaign.failures(entries) == []
    assert {entry["outcome"] for entry in entries} >= {"true, accepted"}


@pytest.mark.slow
def test_the_truth_sees_what_is_false_of_a_lap(campaign: ModuleType, lap_text: str) -> None:
    """Joints, the lap, legs, obstacles and θ are looked at, not only what a steady segment has."""
    assert campaign.is_true(json.loads(lap_text)) == ""

    def judged(*path: Any, value: Any) -> str:
        document = holder = json.loads(lap_text)
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value
        return campaign.is_true(document)

    assert judged("funnels", 0, "rate", value="1/10") == "joint"
    assert judged("funnels", 1, "margin", value="3/2") == "(d)"
    assert judged("funnels", 0, "margin", value="1") == "(d)"
    assert judged("legs", 3, "end", value=5) == "legs"
    assert judged("problem", "path", "pieces", 5, "duration", value="1") == "closed"
    assert judged("problem", "path", "start", 1, value="1") == "obstacle"
    assert judged("problem", "sets", "obstacles", 0, "round", value="1") == "obstacle"
    assert judged("problem", "sets", "footprint", 1, "radius", value="1") == "obstacle"


def test_the_truth_sees_what_is_false(campaign: ModuleType, paper_text: str) -> None:
    """The campaign's own judge must not nod everything through."""
    base = json.loads(paper_text)
    assert campaign.is_true(base) == ""
    rng = random.Random(0)
    for spoil, expected in (("margin raised", "(d)"), ("failing funnel", "(d)")):
        spoiled = campaign.ATTACKS[spoil][0](rng, json.loads(paper_text))
        assert campaign.is_true(spoiled) == expected
    for name, value, expected in (("inlet", "3/5", "(a)"), ("goal", "1/5", "(b)")):
        spoiled = json.loads(paper_text)
        spoiled["problem"]["sets"][name]["half_axes"] = [value] * 4
        assert campaign.is_true(spoiled) == expected
    spoiled = json.loads(paper_text)
    spoiled["problem"]["sets"]["safe"]["half_widths"][1] = "1/2"
    assert campaign.is_true(spoiled) == "(c)"
    spoiled = json.loads(paper_text)
    spoiled["problem"]["vehicle"]["parameters"]["wheelbase"] = "1/3"
    assert campaign.is_true(spoiled) == "vehicle"
    spoiled = json.loads(paper_text)
    spoiled["funnels"][0]["margin_per_metre"] = "1/9"
    assert campaign.is_true(spoiled) == "kind"


def test_the_truth_sees_what_is_false_of_a_tube(campaign: ModuleType, tube_text: str) -> None:
    """Shell and references are searched: each claim that is wrong at some reference alone is found to be."""
    segment_of = importlib.import_module("attacks.truth").segment_of

    def judged(place: str, **changes: Any) -> str:
        spoiled = json.loads(tube_text)
        {"funnel": spoiled["funnels"][0], "bounds": segment_of(spoiled)}[place].update(changes)
        return campaign.is_true(spoiled)

    assert judged("funnel") == ""
    assert judged("bounds", curvature=["-1", "1"]) == judged("bounds", speed=["3/2", "3/2"]) == ""
    assert judged("bounds", curvature=["-3/2", "3"]) == "(d)"
    assert judged("bounds", curvature=["-3", "3/2"]) == "(d)"
    assert judged("bounds", acceleration=["-5", "1/2"]) == "(d)"
    assert judged("bounds", acceleration=["-1/2", "5"]) == "(d)"
    assert judged("bounds", speed=["1/2", "2"]) == "(d)"
    assert judged("funnel", margin="1") == judged("funnel", margin_per_metre="1/2") == "(d)"
    assert judged("funnel", margin="0") == "sign"
    assert judged("funnel", rate="1/100000") == judged("funnel", margin_per_metre=None) == "kind"
    rng = random.Random(0)
    for name in ("margin raised", "failing funnel"):
        assert campaign.is_true(campaign.ATTACKS[name][0](rng, json.loads(tube_text))) == "(d)"


def test_hostile_files_are_refused_quickly(tmp_path: Path, paper_text: str, tube_text: str) -> None:
    for entry in run(tmp_path, (paper_text, tube_text), "--count", "100", "--only", "hostile file"):
        assert entry["outcome"] in ("BROKEN", "UNREADABLE")
        assert len(entry["message"]) < 400  # where the log cuts it off


def test_the_campaign_resumes(
    campaign: ModuleType,
    paper_text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    (tmp_path / "certificate.json").write_text(paper_text)
    log = tmp_path / "log.jsonl"
    for count in ("5", "8"):
        monkeypatch.setattr(sys, "argv", ["attack", str(tmp_path), "--count", count, "--log", str(log)])
        assert campaign.main() == 0
    indices = [json.loads(line)["index"] for line in log.read_text().splitlines()]
    assert indices == list(range(8))
    assert "refused for" in capsys.readouterr().out
