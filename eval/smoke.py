"""Run every benchmark, and the corpus, at its smallest size: what changed elsewhere shows here, not in a year.

    python eval/smoke.py [NAME ...]

Every script in eval/benchmarks takes `--smoke`: seconds instead of minutes, its numbers mean nothing. What needs a
library that is not installed is left out with a line that says so. Ends with 1 where a script does not end with 0.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # eval is no part of the package

from eval.child import run_child

FOLDER = Path(__file__).parent
TIMEOUT_S = 600.0
OTHERS = ("corpus/run.py", "generated.py")
"""Scripts elsewhere in eval. The study is left out: it is commands that tests run, and a page that tests/test_study.py
writes."""
PARTS = ("cavity_peers.py",)
"""Files beside the benchmarks that one of them runs."""


def parser_of(description: str | None) -> argparse.ArgumentParser:
    """Return a script's parser, with the flag that all of them have."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help="the smallest size, only to see that everything runs")
    return parser


def scripts() -> list[Path]:
    """Return the scripts that take --smoke."""
    benchmarks = [path for path in sorted((FOLDER / "benchmarks").glob("*.py")) if path.name not in PARTS]
    return [*benchmarks, *(FOLDER / name for name in OTHERS)]


def main() -> None:
    """Run them one after the other; say how each ended, and of one that failed what it said."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="such as env; all when none is given")
    names = parser.parse_args().names
    wanted = [path for path in scripts() if not names or path.stem in names]
    failed = []
    for path in wanted:
        name = path.relative_to(FOLDER).as_posix()
        ended = run_child([sys.executable, str(path), "--smoke"], TIMEOUT_S)
        print(f"{name:<24} {ended.seconds:6.1f} s, {ended.cpu_seconds:6.1f} s of processor time: ", end="")
        print("too slow" if ended.exit_code is None else f"exit code {ended.exit_code}", flush=True)
        left_out = [line for line in ended.output.splitlines() if "left out" in line]
        print("".join(f"  {line}\n" for line in left_out), end="")
        if ended.exit_code != 0:
            failed.append(name)
            print(ended.output[-1000:] + ended.errors[-3000:], file=sys.stderr, flush=True)
    failures = f" Failed: {', '.join(failed)}." if failed else ""
    print(f"{len(wanted) - len(failed)} of {len(wanted)} ran.{failures}")
    sys.exit(bool(failed) or not wanted)


if __name__ == "__main__":
    main()
