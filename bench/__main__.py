"""`python -m bench [NAME ...] [--quick] [--trials N] [--json]`: what `make bench` and `make bench-quick` run.

A bench that fails is reported, and the others go on; the exit code is 1 then.
"""

from __future__ import annotations

import argparse
import json
import sys
import time

from bench import one
from bench.catalogue import BENCHES
from bench.pairs import Row


def main() -> int:
    """Runs the named benches, or all."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of: {', '.join(BENCHES)}")
    parser.add_argument("--quick", action="store_true", help="fewer pairs; without names, those of the quick set")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--trials", type=int, metavar="N", help="of stop-latency")
    args = parser.parse_args()
    unknown = set(args.names) - set(BENCHES)
    if unknown:
        print(
            f"bench: no bench is called {', '.join(sorted(unknown))}. There are: {', '.join(BENCHES)}", file=sys.stderr
        )
        return 2
    names = args.names or [name for name, bench in BENCHES.items() if bench.quick or not args.quick]
    rows: list[Row] = []
    failed: dict[str, str] = {}
    took: dict[str, float] = {}
    for name in names:
        if not args.json:
            print(name, flush=True)
        function, arguments, _ = BENCHES[name]
        if name == "stop-latency" and args.trials is not None:
            arguments = (args.trials,)
        started = time.monotonic()
        found, why = one.run(function, arguments, args.quick)
        took[name] = round(time.monotonic() - started, 1)
        rows += found
        if not args.json:
            for row in found:
                print(f"  {_words(row)}", flush=True)
        if why:
            failed[name] = why
            if not args.json:
                print(f"  FAILED: {why}", flush=True)
        if not args.json:
            print(f"  in {took[name]:g} s", flush=True)
    if args.json:
        print(json.dumps({"benches": [row.metrics() for row in rows], "failed": failed, "seconds": took}))
    else:
        slowest = sorted(took, key=lambda name: -took[name])[:3]
        spent = ", ".join(f"{name} {took[name]:g} s" for name in slowest)
        print(f"{len(names)} benches in {sum(took.values()):.0f} s (longest: {spent}); {len(failed)} failed")
        for name, why in failed.items():
            print(f"  {name}: {why}")
    return 1 if failed else 0


def _words(row: Row) -> str:
    judged = "" if row.holds is None else f"  aim {row.aim}: {'met' if row.holds else 'NOT met'}"
    control = "" if row.control is None else f", A/A {row.control:g}{_between(row.control_interval)}"
    control += f", {row.pairs} pairs" if row.pairs else ""
    ratio = f"ratio {row.ratio:g}{_between(row.interval)}"
    return f"{row.what}: {row.ours:g} {row.unit}, {row.other_name} {row.other:g}, {ratio}{control}{judged}"


def _between(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else " ({:g} to {:g})".format(*interval)


if __name__ == "__main__":
    sys.exit(main())
