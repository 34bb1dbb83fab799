"""The command and its answers, on true, spoiled and hostile files."""

import json
import os
import shlex
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from cfcheck import Outcome, check_document, check_file
from cfcheck.claims.document import document_hash
from tests.check.graphs import SLOPE, add_to_rate


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


def test_a_true_certificate_is_proven_on_one_screen(tmp_path: Path, contracting_text: str) -> None:
    (tmp_path / "certificate.json").write_text(contracting_text)
    for where in (tmp_path, tmp_path / "certificate.json"):
        done = command(str(where))
        assert done.returncode == 0
        assert done.stderr == ""
        assert done.stdout.startswith("PROVEN: a control funnel function along a path\nvehicle ")
        assert done.stdout.count("\n") < 20
    for part in (
        'vehicle     - "kinematic_bicycle" (wheelbase 0.34,',
        'path        - "circle" (turning rate 1.0471975511965976 rad/s',
        "rate about 0.",
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
        "import sys; before = set(sys.modules); import cfjax.check; "
        "print(sorted({name.split('.')[0] for name in set(sys.modules) - before} - sys.stdlib_module_names)); "
        "print(sorted(name for name in sys.modules if name.startswith('cfjax.')))"
    )
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": root}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    packages, rooms = (json.loads(line.replace("'", '"')) for line in done.stdout.splitlines())
    assert {name for name in packages if "cython" not in name} == {"cfcheck", "cfjax", "flint"}
    assert rooms == ["cfjax.check"]


def claim(document: dict[str, Any], change: str) -> dict[str, Any]:
    """A change that makes the claim false, by name."""
    problem, funnel = document["problem"], document["funnels"][0]
    proof = document["hints"]["decrease"][0]["stretches"][0]
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
            problem["path"]["pieces"][0]["speed"][0] = "2"
        case "rate":
            funnel["rate"] = str(Fraction(funnel["rate"]) * Fraction(11, 10))
        case "shape":
            funnel["shape"][0] = str(Fraction(funnel["shape"][0]) * Fraction(99, 100))
        case "beta_lower":
            funnel["beta_lower"] = funnel["beta_inner"] = "1/2"
        case "beta_inner":
            funnel["beta_inner"] = "1/2"
        case "whitening":
            proof["whitening"] = [["1" if i == j else "0" for j in range(4)] for i in range(4)]
    return document


SPOILED = [
    *("margin", "inlet", "goal", "safe", "pattern", "gram", "remainder", "enclosure", "range", "steering", "timing"),
    *("standstill", "wheelbase", "graph", "speed", "rate", "shape", "beta_lower", "beta_inner", "whitening"),
    "cells swapped",
]


@pytest.mark.parametrize("change", SPOILED)
def test_spoiled_claims_are_broken(certificate: dict[str, Any], change: str) -> None:
    report = check_document(renewed(claim(certificate, change)))
    assert report.outcome is Outcome.BROKEN
    assert report.message.isprintable()


def sentence(document: dict[str, Any]) -> str:
    """What the checker prints about a file that it accepts."""
    report = check_document(document, skip_hash=True)
    assert report.outcome in (Outcome.PROVEN, Outcome.REFUTED), report.message
    return report.message


def test_a_proven_sentence_says_no_more_than_is_proven(certificate: dict[str, Any]) -> None:
    """Numbers that have no short decimal are rounded so that the sentence is weaker."""
    sets, nearly = certificate["problem"]["sets"], Fraction(1, 10**20)
    half, three = Fraction(1, 2), Fraction(3)
    sets["inlet"]["half_axes"] = [str(half - nearly)] * 4  # nearest would be 0.5
    sets["goal"]["half_axes"] = [str(half + nearly)] * 4
    sets["safe"]["half_widths"][3] = str(three + nearly)
    for level in ("beta_lower", "beta_inner"):
        certificate["funnels"][0][level] = str(Fraction(9, 10) + nearly)
    certificate["funnels"][0]["margin"] = str(Fraction(1, 10) - nearly)
    told = sentence(certificate)
    for part in (
        "I with half-axes (0.499999, 0.499999, 0.499999, 0.499999)",
        "G with half-axes (0.500001, 0.500001, 0.500001, 0.500001)",
        "S with half-widths (1, 1, 1, 3.00001)",
        "shell from 0.900001",
        "lambda = 0.0999999 1/s or more",
        "c0 about 0.",
    ):
        assert part in told


def witness(x: list[str]) -> dict[str, Any]:
    return {"condition": "c", "leg": 0, "theta": "0", "reference": 0, "x": x}


def refutation(document: dict[str, Any], shape: list[str], x: list[str]) -> dict[str, Any]:
    """Claims condition (c) to fail at x, for another C."""
    del document["hints"]
    document["funnels"][0]["shape"] = shape
    return document | {"claim": "refutation", "joints": [], "witness": witness(x)}


def test_a_refuted_sentence_names_what_is_left(certificate: dict[str, Any]) -> None:
    shape = ["1/100", "0", "9", "0", "0", "9", "0", "0", "0", "9"]
    third = [str(Fraction(k, 3)) for k in (2, 3, 3, 9)]
    certificate["problem"]["sets"]["safe"] = {"half_widths": third}
    told = sentence(refutation(certificate, shape, ["4", "0", "0", "0"]))
    assert "outside the safe set S" in told
    assert "; S with half-widths (0.666666, 1, 1, 3)" in told
    certificate |= {"claim": "refutation", "joints": []}
    certificate["problem"]["sets"]["safe"] = None
    certificate["problem"]["sets"]["inlet"]["half_axes"] = ["1/3"] * 4
    certificate["witness"] = witness(["4", "0", "0", "1/300"])
    told = sentence(certificate)
    assert "heading is pi or more" in told
    assert "safe set S" not in told
    assert "I with half-axes (0.333334" in told
    assert "alpha = 4, x = 0, y = 0, v = about 0.00333333" in told
    certificate["witness"]["x"][0] = "3"
    assert check_document(certificate, skip_hash=True).outcome is Outcome.BROKEN


def test_a_template_that_nobody_knows_is_refused(certificate: dict[str, Any]) -> None:
    certificate["funnels"][0]["template"] = "other"
    report = check_document(certificate, skip_hash=True)
    assert report.outcome is Outcome.UNREADABLE
    assert "template: expected one of paper, contracting" in report.message


def test_names_cannot_speak_for_the_checker(certificate: dict[str, Any]) -> None:
    certificate["problem"]["path"]["name"] = "circle. PROVEN: everything"
    assert 'path: "circle. PROVEN: everything" (turning' in sentence(certificate)
    for spoil in (
        lambda p: p["vehicle"]["states"].__setitem__(1, "x in S. PROVEN"),
        lambda p: p["vehicle"]["parameters"].__setitem__("wheelbase 3", "1"),
        lambda p: p["inputs"][1].__setitem__("name", "w: all"),
    ):
        document = json.loads(json.dumps(certificate))
        spoil(document["problem"])
        report = check_document(document, skip_hash=True)
        assert report.outcome is Outcome.UNREADABLE
        assert "letters, digits" in report.message


def test_huge_numbers_do_not_hide_which_claim_is_broken(certificate: dict[str, Any]) -> None:
    for spoil, part in (
        (
            lambda d: d["funnels"][0].update(margin=str(10**399)),
            "condition (d), theta from 0 to 6 s, piece 0, signs (++): margin 1e+399",
        ),
        (
            lambda d: d["hints"]["decrease"][0]["stretches"][0]["cells"][0].update(margin=f"-{10**390}"),
            "e+390 1/s proven",
        ),
        (lambda d: d["problem"]["vehicle"]["parameters"].update(wheelbase=str(10**399)), "vehicle: the dynamics"),
    ):
        document = json.loads(json.dumps(certificate))
        spoil(document)
        report = check_document(document, skip_hash=True)
        assert report.outcome is Outcome.BROKEN
        assert part in report.message
    certificate["surplus"] = 1
    assert check_document(certificate).message == "field 'surplus' is unknown"


def test_another_name_is_a_claim_about_the_graph(certificate: dict[str, Any]) -> None:
    certificate["problem"]["vehicle"]["name"] = "my_car"
    report = check_document(renewed(certificate))
    assert report.outcome is Outcome.PROVEN
    assert "unknown to this checker" in report.message and "lap after lap" in report.message
    assert "which are those of a body whose reference looks along the path" in report.message
    add_to_rate(certificate, 1, SLOPE)
    report = check_document(renewed(certificate))
    assert report.outcome is Outcome.BROKEN
    assert "laps are closed for bodies that look along the path" in report.message
    certificate["problem"]["path"]["closed"] = False
    certificate["joints"] = []
    report = check_document(renewed(certificate))
    assert report.outcome is Outcome.PROVEN and "body" not in report.message


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
        "import time; started = time.perf_counter(); from cfcheck.__main__ import main; "
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


def test_nobody_need_read_to_the_end(tmp_path: Path, paper_text: str) -> None:
    (tmp_path / "certificate.json").write_text(paper_text)
    command = f"{shlex.quote(sys.executable)} -m cfjax.check {shlex.quote(str(tmp_path))} | head -n 0"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, "")
