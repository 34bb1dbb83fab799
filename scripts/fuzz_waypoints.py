"""The adversary of the reader of points: files as people write them, read as they were meant or refused in one line.

    python scripts/fuzz_waypoints.py [--count 10000] [--seed 0] [--whole 50]

Every seed writes one path of known length in one of its many forms (`tests/written.py`). A file that is read has that
length in metres, is a lap if one was meant, and has the speeds that were meant; one that can be read in one way only is
never refused. Of one in `--whole` the curve is made too, and measured. Exit code 0: all of it was so; 1 otherwise, with
the seeds.
"""

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path


ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    sys.path.insert(0, str(ROOT))
    from tests.problem.test_point_files import check
    from tests.written import written

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--whole", type=int, default=50)
    given = parser.parse_args()
    seen, failed = Counter(), 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "points.csv"
        for seed in range(given.seed, given.seed + given.count):
            meant = written(seed)
            try:
                read = check(file, meant, whole=seed % given.whole == 0)
            except Exception as error:
                failed += 1
                print(f"seed {seed}: {type(error).__name__}: {' '.join(str(error).split())[:300]}", flush=True)
            else:
                seen["read" if read else "refused", "clear" if meant.clear else "not clear"] += 1
    counts = ", ".join(f"{count} {how} ({kind})" for (how, kind), count in sorted(seen.items()))
    print(f"{given.count} files: {counts}; {failed} wrong")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
