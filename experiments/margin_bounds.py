"""Certified margins beside proven upper bounds: `python experiments/margin_bounds.py`.

On a straight line of 4 m at 2 m/s, with the paper's template, I and G being balls of 0.5. The bound is the smallest one
of a few multiples of the falsified margin for which a proof is found.
"""

import argparse
import json
import time

import cfjax
from cfcheck import check_document
from cfjax.bracket import upper_bound
from cfjax.certificate import dump


SHARES = (3.0, 1.5, 1.2, 1.1, 1.05)  # of the falsified margin, tried in turn


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--beta-lower", type=float, nargs="+", default=[0.8, 0.9, 0.95])
    parser.add_argument("--method", choices=("pf", "tt"), nargs="+", default=["tt"])
    parser.add_argument("--boxes", type=int, default=20_000, help="the most of one search")
    given = parser.parse_args()
    print("| row | method | β̲ | certified, 1/s | falsified | proven bound | leaves | kB | search, s | replay, s |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for method in given.method:
        for beta in given.beta_lower:
            problem = cfjax.Problem(cfjax.straight(), method=method)
            options = cfjax.Options(template="paper", beta_lower=beta, cars=0, robustness=False)
            result = cfjax.synthesize(problem, options)
            best = None
            for share in SHARES:
                begin = time.perf_counter()
                wanted = float(f"{share * (result.margin_falsified or 0):.3g}")
                found = upper_bound(problem, wanted, beta_lower=beta, most_boxes=given.boxes)
                if found is None:
                    break
                best = found, time.perf_counter() - begin
            print(f"| straight | {method} | {beta} | {result.margin_certified} | {result.margin_falsified} |", end="")
            if best is None:
                print(" none found | | | | |", flush=True)
                continue
            bound, spent = best
            text = dump(bound.document)
            begin = time.perf_counter()
            report = check_document(json.loads(text))
            assert report.outcome.name == "BOUNDED", report.message
            replay = time.perf_counter() - begin
            size = len(text) / 1000
            print(f" {bound.margin:g} | {bound.leaves} | {size:.0f} | {spent:.0f} | {replay:.1f} |", flush=True)


if __name__ == "__main__":
    main()
