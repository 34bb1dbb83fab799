"""A short version of the campaign in `scripts/attack_certificates.py`: every attack, a few times."""

import importlib.util
import json
import random
import sys
from pathlib import Path
from types import ModuleType

import pytest

from cfjax.check import Outcome


@pytest.fixture(scope="module")
def campaign() -> ModuleType:
    path = Path(__file__).parents[2] / "scripts" / "attack_certificates.py"
    spec = importlib.util.spec_from_file_location("attack_certificates", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_nothing_false_is_accepted(campaign: ModuleType, paper_text: str, contracting_text: str) -> None:
    entries = [campaign.attack(index, 1, [paper_text, contracting_text]) for index in range(200)]
    assert campaign.failures(entries) == []
    assert {entry["attack"] for entry in entries} == set(campaign.ATTACKS)
    assert sum(entry["outcome"] == "true, accepted" for entry in entries) > 5  # the truth is told apart
    assert "total" in campaign.table(entries)


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


def test_hostile_files_are_refused_quickly(campaign: ModuleType, paper_text: str) -> None:
    for index in range(40):
        content = campaign.hostile_file(random.Random(index), json.loads(paper_text))
        report, _ = campaign.judge(content)
        assert report.outcome in (Outcome.BROKEN, Outcome.UNREADABLE)
        assert report.message.isprintable()
        assert len(report.message) < 400


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
