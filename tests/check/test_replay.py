"""The command and its answers, on true, spoiled and hostile files."""

import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from cfjax.check import Outcome, check_document, check_file
from cfjax.check.document import document_hash


def command(*arguments: str) -> subprocess.CompletedProcess:
    root = str(Path(__file__).parents[2])
    return subprocess.run(
        [sys.executable, "-W", "error", "-m", "cfjax.check", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PYTHONPATH": root},
        check=False,
    )


def renewed(document: dict[str, Any]) -> dict[str, Any]:
    return {**document, "hash": document_hash(document)}


def write(folder: Path, document: dict[str, Any]) -> Path:
    path = folder / "certificate.json"
    path.write_text(json.dumps(document))
    return path


def test_a_true_certificate_is_proven_in_one_paragraph(tmp_path: Path, contracting_text: str) -> None:
    (tmp_path / "certificate.json").write_text(contracting_text)
    for where in (tmp_path, tmp_path / "certificate.json"):
        done = command(str(where))
        assert done.returncode == 0
        assert done.stderr == ""
        assert done.stdout.count("\n") == 1
    for part in (
        "kinematic_bicycle",
        "wheelbase 0.34",
        "circle",
        "half-axes",
        "u0 in [1, 1]",
        "6 to 6 s",
        "lambda = 1.6",
    ):
        assert part in done.stdout
    report = check_file(tmp_path)
    assert report.outcome is Outcome.PROVEN
    assert [float(margin) for margin in report.margins] == pytest.approx([1.61], abs=0.01)


def test_exit_codes(tmp_path: Path, certificate: dict[str, Any]) -> None:
    certificate["funnels"][0]["margin"] = str(Fraction(certificate["funnels"][0]["margin"]) / 2)
    path = write(tmp_path, certificate)
    changed = command(str(path))
    assert (changed.returncode, changed.stdout.startswith("BROKEN: hash")) == (1, True)
    assert command(str(path), "--skip-hash").returncode == 0
    certificate["problem"]["sets"]["inlet"]["half_axes"] = ["3/5"] * 4
    broken = command(str(write(tmp_path, certificate)), "--skip-hash")
    assert (broken.returncode, broken.stdout.count("\n"), broken.stderr) == (1, 1, "")
    assert "condition (a)" in broken.stdout
    for missing in (
        str(tmp_path / "nothing.json"),
        str(tmp_path / "a\nb"),
        "/dev/null",
        str(tmp_path.parent / "nowhere"),
    ):
        done = command(missing)
        assert (done.returncode, done.stdout.count("\n"), done.stderr) == (2, 1, "")


def test_nothing_but_python_flint_is_imported() -> None:
    program = (
        "import sys; before = set(sys.modules); import cfjax.check.__main__; "
        "print(sorted({name.split('.')[0] for name in set(sys.modules) - before} - sys.stdlib_module_names)); "
        "print(sorted(name for name in sys.modules if name.startswith('cfjax.')))"
    )
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": root}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    packages, rooms = (json.loads(line.replace("'", '"')) for line in done.stdout.splitlines())
    assert {name for name in packages if "cython" not in name} == {"cfjax", "flint"}
    assert all(name == "cfjax.check" or name.startswith("cfjax.check.") for name in rooms)


def claim(document: dict[str, Any], change: str) -> dict[str, Any]:
    """A change that makes the claim false, by name."""
    problem, funnel, proof = document["problem"], document["funnels"][0], document["proofs"][0]
    match change:
        case "margin":
            funnel["margin"] = str(Fraction(funnel["margin"]) + Fraction(1, 100))
        case "inlet":
            problem["sets"]["inlet"]["half_axes"][0] = "3/5"
        case "goal":
            problem["sets"]["goal"]["half_axes"][1] = "1/4"
        case "safe":
            problem["sets"]["safe"]["half_widths"][1] = "1/2"
        case "pattern":
            del proof["cells"][2]
        case "cells swapped":
            first, second = proof["cells"][:2]
            first["signs"], second["signs"] = second["signs"], first["signs"]
        case "gram":
            proof["cells"][0]["grams"][0]["lower"][0] *= -1
        case "remainder":
            proof["enclosures"][0]["bound"] = str(Fraction(proof["enclosures"][0]["bound"]) * Fraction(9, 10))
        case "enclosure":
            proof["enclosures"].pop()
        case "range":
            proof["enclosures"][0]["upper"] = "1/2"
        case "steering":
            problem["inputs"][1]["upper"] = "2"
        case "timing":
            problem["inputs"][0]["lower"] = "1/2"
        case "standstill":
            problem["inputs"][0]["lower"] = "0"
        case "wheelbase":
            problem["vehicle"]["parameters"]["wheelbase"] = "1/3"
        case "graph":
            node = next(node for node in problem["vehicle"]["dynamics"]["nodes"] if node[0] == "sin")
            node[0] = "cos"
        case "speed":
            problem["path"]["segments"][0]["speed"]["coefficients"][0][0] = "2"
        case "rate":
            funnel["rate"] = str(Fraction(funnel["rate"]) * Fraction(11, 10))
        case "shape":
            funnel["shape"][0] = str(Fraction(funnel["shape"][0]) * Fraction(99, 100))
        case "beta_lower":
            funnel["beta_lower"] = "1/2"
        case "whitening":
            proof["whitening"] = [["1" if i == j else "0" for j in range(4)] for i in range(4)]
    return document


SPOILED = [
    *("margin", "inlet", "goal", "safe", "pattern", "gram", "remainder", "enclosure", "range", "steering", "timing"),
    *("standstill", "wheelbase", "graph", "speed", "rate", "shape", "beta_lower", "whitening", "cells swapped"),
]


@pytest.mark.parametrize("change", SPOILED)
def test_spoiled_claims_are_broken(certificate: dict[str, Any], change: str) -> None:
    report = check_document(renewed(claim(certificate, change)))
    assert report.outcome is Outcome.BROKEN
    assert report.message.isprintable()


def test_another_name_is_a_claim_about_the_graph(certificate: dict[str, Any]) -> None:
    certificate["problem"]["vehicle"]["name"] = "my_car"
    report = check_document(renewed(certificate))
    assert report.outcome is Outcome.PROVEN
    assert "unknown to this checker" in report.message


def test_every_field_is_needed_and_no_other_taken(certificate: dict[str, Any], paper_text: str) -> None:
    def objects(value: Any) -> list[dict]:
        if isinstance(value, dict):
            return [value, *(o for child in value.values() for o in objects(child))]
        return [o for child in value for o in objects(child)] if isinstance(value, list) else []

    count = len(objects(certificate))
    for k in range(0, count, 3):
        for spoil in ("drop", "add"):
            document = json.loads(paper_text)
            target = objects(document)[k]
            if spoil == "drop" and target:
                target.pop(sorted(target)[k % len(target)])
            else:
                target["surplus"] = 1.5
            assert check_document(document, skip_hash=True).outcome in (Outcome.UNREADABLE, Outcome.BROKEN)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads the peak of its memory from /proc")
def test_memory_and_time(tmp_path: Path, contracting_text: str) -> None:
    """The promise is 10 s and 500 MB; both are far away."""
    (tmp_path / "certificate.json").write_text(contracting_text)
    program = (
        "import time; started = time.perf_counter(); from cfjax.check.__main__ import main; "
        f"code = main([{str(tmp_path)!r}]); "
        "peak = next(line for line in open('/proc/self/status') if line.startswith('VmHWM')); "
        "print(code, time.perf_counter() - started, peak.split()[1])"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    code, seconds, kilobytes = done.stdout.split()[-3:]
    assert code == "0"
    assert float(seconds) < 10
    assert float(kilobytes) < 100_000
