"""`python -m bench [NAME ...] [--trials N] [--json]`: what `make bench` runs."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from functools import partial

from bench import (
    arm_angles,
    can_actuators,
    clock,
    collision,
    compiled,
    drivers,
    dynamixel,
    ikns,
    noitom,
    object_mapping,
    panda,
    panel,
    pycgm,
    sibson,
    sixth_finger,
    skeleton,
    stop_latency,
    superman,
    ur,
    whole_body_laws,
)
from bench.pairs import Row

BENCHES: dict[str, Callable[[], list[Row]]] = {
    "arm-angles": arm_angles.run,
    "can-actuators": can_actuators.run,
    "clock-100hz": lambda: clock.run(100),
    "clock-1khz": lambda: clock.run(1000),
    "collision": collision.run,
    "compiled": compiled.run,
    "drivers": drivers.run,
    "dynamixel": dynamixel.run,
    "ikns-cycle": ikns.run,
    "noitom-text": noitom.run,
    "object-mapping": object_mapping.run,
    "panda-cycle": panda.run,
    "panel": panel.run,
    "ur-rtde-receive": ur.run,
    "pycgm": pycgm.run,
    "sibson": sibson.run,
    "skeleton": skeleton.run,
    "cycle-sixth-finger": sixth_finger.cycle,
    "sim-sixth-finger": sixth_finger.speed,
    "stop-latency": stop_latency.run,
    "superman": superman.run,
    "superman-laws": whole_body_laws.run,
    "telemetry-1khz": sixth_finger.telemetry,
}


def main() -> int:
    """Runs the named benches, or all."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of: {', '.join(BENCHES)}")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument(
        "--trials", type=int, default=stop_latency.TRIALS, metavar="N", help="of stop-latency (%(default)s)"
    )
    args = parser.parse_args()
    unknown = set(args.names) - set(BENCHES)
    if unknown:
        print(
            f"bench: no bench is called {', '.join(sorted(unknown))}. There are: {', '.join(BENCHES)}", file=sys.stderr
        )
        return 2
    rows = []
    for name in args.names or BENCHES:
        if not args.json:
            print(name, flush=True)
        bench = BENCHES[name] if name != "stop-latency" else partial(stop_latency.run, args.trials)
        for row in bench():
            rows.append(row)
            if not args.json:
                judged = "" if row.holds is None else f"  aim {row.aim}: {'met' if row.holds else 'NOT met'}"
                control = "" if row.control is None else f", A/A {row.control:g}{_between(row.control_interval)}"
                ratio = f"ratio {row.ratio:g}{_between(row.interval)}"
                measured = f"{row.ours:g} {row.unit}, {row.other_name} {row.other:g}, {ratio}{control}"
                print(f"  {row.what}: {measured}{judged}", flush=True)
    if args.json:
        print(json.dumps({"benches": [row.figures() for row in rows]}))
    return 0


def _between(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else " ({:g} to {:g})".format(*interval)


if __name__ == "__main__":
    sys.exit(main())
