"""The adversary of the checker: thousands of spoiled certificates, none of which may be accepted for something false.

    python scripts/attack_certificates.py RUN_OR_CERTIFICATE... [--count 10000] [--candidates 50]

The attacks are in `attacks/`, a module for each kind. Each spoiled file has the hash of its content, so that the
checker has to find what is wrong in the content. `attacks/truth.py` judges each file that the checker accepts, without
the checker's code. A campaign can be resumed: what stands in the log is not tried again. Exit code 0: nothing false was
accepted, nothing crashed or hung; 1 otherwise.
"""

import argparse
import json
import random
import sys
import time
from collections import Counter, defaultdict
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

from attacks.candidates import attack_candidate
from attacks.document import Attack, Document, margin_names, renewed
from attacks.fields import any_field, field_dropped, fields_swapped, number_field
from attacks.funnels import (
    claim_turned,
    failing_funnel,
    funnel_changed,
    leg_changed,
    margin_lowered,
    margin_raised,
    model_changed,
)
from attacks.hostile import hostile_file
from attacks.margins import METRE, SECOND
from attacks.problems import inputs_changed, path_changed, place_changed, sets_changed, vehicle_changed
from attacks.proofs import (
    function_dropped,
    gram_entry,
    gram_exponent,
    gram_size,
    mirror_broken,
    pattern_left_out,
    remainder_lowered,
    stretch_changed,
)
from attacks.truth import is_true

from cfcheck import Outcome, Report, check_document
from cfcheck.reader import Unreadable, parse_json
from cfcheck.replay import CERTIFICATE_NAME


LONGEST = 60.0  # seconds that any file may take, on a busy machine; the hostile ones take far less


ATTACKS: dict[str, tuple[Attack, int]] = {  # with weights
    "any field": (any_field, 16),
    "number moved": (number_field, 12),
    "field dropped": (field_dropped, 4),
    "fields swapped": (fields_swapped, 6),
    "Gram entry": (gram_entry, 10),
    "Gram exponent": (gram_exponent, 2),
    "Gram size": (gram_size, 2),
    "margin raised": (margin_raised, 10),
    "margin lowered": (margin_lowered, 1),
    "pattern left out": (pattern_left_out, 5),
    "remainder lowered": (remainder_lowered, 5),
    "sets changed": (sets_changed, 6),
    "inputs changed": (inputs_changed, 4),
    "vehicle changed": (vehicle_changed, 6),
    "path changed": (path_changed, 8),
    "leg changed": (leg_changed, 6),
    "model changed": (model_changed, 6),
    "stretch changed": (stretch_changed, 8),
    "place changed": (place_changed, 8),
    "function dropped": (function_dropped, 2),
    "mirror broken": (mirror_broken, 6),
    "funnel changed": (funnel_changed, 6),
    "failing funnel": (failing_funnel, 4),
    "claim turned": (claim_turned, 3),
    "hostile file": (hostile_file, 6),
}


def judge(content: bytes) -> tuple[Report, Any]:
    try:
        document = parse_json(content)
    except Unreadable as error:
        return Report(Outcome.UNREADABLE, str(error)), None
    return check_document(document), document


def attack(index: int, seed: int, bases: list[str], only: str | None = None) -> dict[str, Any]:
    """The attack of that number: always the same one. Says what was tried and what came of it."""
    rng = random.Random(f"{seed}:{index}")
    base = rng.choice(bases)
    name = only or rng.choices(list(ATTACKS), [weight for _, weight in ATTACKS.values()])[0]
    spoiled = ATTACKS[name][0](rng, json.loads(base))
    content = spoiled if isinstance(spoiled, bytes) else renewed(spoiled)
    entry: dict[str, Any] = {"index": index, "attack": name}
    started = time.perf_counter()
    try:
        report, document = judge(content)
    except Exception as error:  # nothing may escape the checker
        return {**entry, "outcome": "CRASHED", "message": repr(error)[:300]}
    seconds = time.perf_counter() - started
    entry |= {"outcome": report.outcome.name, "seconds": round(seconds, 3), "message": report.message[:400]}
    if "\n" in report.message or not report.message.isprintable():
        entry["outcome"] = "CRASHED"
    if seconds > LONGEST:
        entry["outcome"] = "HUNG"
    if report.outcome is Outcome.PROVEN:
        false = "" if _same_or_weaker(document, json.loads(base)) else is_true(document, seed=index)
        entry["outcome"] = f"FALSE {false} ACCEPTED" if false else "true, accepted"
    if report.outcome is Outcome.REFUTED:
        entry["outcome"] = "FALSE REFUTATION"  # no attack makes a true one: the bases are proven funnels
    return entry


def _same_or_weaker(document: Document, base: Document) -> bool:
    """Whether the file claims what the base did, with margins that are not larger."""

    def statement(file: Document) -> Any:
        funnels = [{**funnel, SECOND: "", METRE: ""} for funnel in file["funnels"]]
        return [file["problem"], funnels, file["legs"]]

    return statement(document) == statement(base) and all(
        given[name] is not None and 0 < Fraction(given[name]) <= Fraction(before[name])
        for given, before in zip(document["funnels"], base["funnels"], strict=True)
        for name in margin_names(before)
    )


def table(entries: list[dict[str, Any]]) -> str:
    """What was tried, what came of it, and the most frequent reasons."""
    outcomes = ["BROKEN", "UNREADABLE", "true, accepted"]
    lines = [f"{'attack':20}{'tried':>7}{'broken':>8}{'unread.':>8}{'true':>6}{'FAILED':>8}{'slowest':>9}  refused for"]
    grouped = defaultdict(list)
    for entry in entries:
        grouped[entry["attack"]].append(entry)
    for name in [*ATTACKS, "candidate", "total"]:
        rows = entries if name == "total" else grouped[name]
        counts = Counter(row["outcome"] for row in rows)
        reasons = Counter(
            _reason(row["message"]) for row in rows if row["outcome"] in ("BROKEN", "UNREADABLE") and name != "total"
        )
        common = "; ".join(f"{reason} ({count})" for reason, count in reasons.most_common(3))
        slowest = max((row.get("seconds", 0.0) for row in rows), default=0.0)
        numbers = [len(rows), *(counts[o] for o in outcomes), sum(c for o, c in counts.items() if o not in outcomes)]
        widths = (7, 8, 8, 6, 8)
        cells = "".join(f"{n:>{w}}" for n, w in zip(numbers, widths, strict=True))
        lines.append(f"{name:20}{cells}{slowest:>8.2f}s  {common}")
    return "\n".join(lines)


def _reason(message: str) -> str:
    """A message without its numbers and places."""
    words = message.split(": ")
    return " ".join("#" if any(c.isdigit() for c in word) else word for word in words[-1].split())[:60]


def failures(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [entry for entry in entries if entry["outcome"] not in ("BROKEN", "UNREADABLE", "true, accepted")]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("certificates", nargs="+", type=Path, metavar="RUN_OR_CERTIFICATE")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--candidates", type=int, default=0, help="funnels spoiled before their proof")
    parser.add_argument("--only", choices=ATTACKS, help="this kind of attack")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, default=Path("attacks.jsonl"))
    options = parser.parse_args()
    files = [path / CERTIFICATE_NAME if path.is_dir() else path for path in options.certificates]
    bases = [path.read_text() for path in files]
    for path, base in zip(files, bases, strict=True):
        report, _ = judge(base.encode())
        if report.outcome is not Outcome.PROVEN:
            parser.error(f"{path}: expected a certificate that proves a funnel; {report.message}")
    lines = options.log.read_text().splitlines() if options.log.exists() else []
    entries = [json.loads(line) for line in lines if line.endswith("}")]
    done = {entry["index"] for entry in entries}
    with options.log.open("a") as log:
        jobs = [(partial(attack, only=options.only), k, k) for k in range(options.count)]
        jobs += [(attack_candidate, k, f"candidate {k}") for k in range(options.candidates)]
        for make, index, name in jobs:
            if name in done:
                continue
            entries.append(make(index, options.seed, bases))
            log.write(json.dumps(entries[-1]) + "\n")
            log.flush()
            if len(entries) % 500 == 0:
                print(f"{len(entries)} of {len(jobs)}, {len(failures(entries))} failures", flush=True)
    print(table(entries))
    for entry in failures(entries)[:20]:
        print(json.dumps(entry))
    return 1 if failures(entries) else 0


if __name__ == "__main__":
    sys.exit(main())
