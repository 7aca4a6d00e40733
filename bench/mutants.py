"""Mutation testing, sampled: changes one expression of a module at a time and names the changes that no test notices.

    python bench/mutants.py GROUP [--minutes 10] [--sample 60] [--seed 0] [--jobs 2] [--only PATTERN]

mutmut makes and runs the mutants, in out/mutants/GROUP: the checkout stays as it is. `make mutants` takes each group in
turn. A survivor is a place to look, no verdict. There is no C in that folder, so Python computes what C does elsewhere.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

ROOT = Path(__file__).resolve().parents[1]
LINKED = ("bench", "docs", "native", "profiles", "README.md", "pyproject.toml")
COPIED = ("tests", *LINKED[:-1])  # by mutmut, at each of its runs
# By group: the modules that are changed, and the tests that should notice.
# One group a module in the guard: its functions are hot, and so a run of all its tests through mutmut takes minutes.
CLEAR = ["verified*", "limits_clear", "extent"]
GUARD = {
    "approach": ["approach"], "braking": ["braking", "position"], "position": ["position", *CLEAR, "resynchronise"],
    "velocity": ["velocity", *CLEAR], "torque": ["torque", "limits", "verified"], "sent": ["sent*", "resynchronise"],
    "samples": ["samples*", "rates"], "following": ["following*"], "verified": CLEAR,
    "base": ["limits", "position", "velocity", "torque", "resynchronise", "sent*", "verified", "fast"],
}  # fmt: skip
UNITS = ("servo_bus/units", "dynamixel/family", "feetech/units", "firmata/config")
GROUPS = {
    name: ([f"srl/runtime/guard/{name}.py"], [f"tests/guard/test_{each}.py" for each in tests])
    for name, tests in GUARD.items()
} | {
    "loop": (
        [f"srl/runtime/loop/{name}.py" for name in ("machine", "cycle", "faults", "guards")],
        ["tests/loop"],
    ),
    "units": (
        [f"srl/drivers/{name}.py" for name in UNITS],
        [f"tests/drivers/test_{name}*.py" for name in ("servo_units", "dynamixel", "feetech", "firmata")],
    ),
}


def operators() -> None:
    """Adds the changes that matter here and mutmut has none of: a bound that is gone, a condition that is fixed."""
    import libcst as cst
    from mutmut.mutation import mutators

    def without_bound(node: cst.Call) -> Iterator[cst.BaseExpression]:
        name = cst.Module([]).code_for_node(node.func)
        plain = all(not arg.star and (arg.keyword is None or arg.keyword.value == "out") for arg in node.args)
        if name in ("min", "max", "np.minimum", "np.maximum", "np.clip") and plain and len(node.args) > 1:
            for arg in node.args[: 1 if name == "np.clip" else 2]:
                yield arg.value.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()])

    def fixed(node: cst.Comparison | cst.BooleanOperation) -> Iterator[cst.Name]:
        yield from (cst.Name("True"), cst.Name("False"))

    every = cast(list[Any], mutators.mutation_operators)
    # Strings and assignments of None are killed by any call, or are messages.
    every[:] = [each for each in every if each[0] not in (cst.BaseString, cst.Assign, cst.AnnAssign)]
    every += [(cst.Call, without_bound), (cst.Comparison, fixed), (cst.BooleanOperation, fixed)]


def mutmut(*arguments: str, seconds: float | None = None) -> str:
    """Runs mutmut in the present folder, interrupted after so many seconds; returns what it printed."""
    command = [sys.executable, str(Path(__file__).resolve()), "--mutmut", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            return process.communicate(timeout=seconds)[0]
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)
            return process.communicate()[0]


def statuses() -> list[tuple[str, str]]:
    """Each mutant and what became of it."""
    return re.findall(r"^\s*(\S+__mutmut_\d+): (.+)$", mutmut("results", "--all", "1"), re.M)


def prepare(group: str) -> None:
    """A folder with copies and links of the checkout, and mutmut's settings; becomes the present one."""
    modules, tests = GROUPS[group]
    folder = ROOT / "out" / "mutants" / group
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    os.chdir(folder)
    for name in LINKED:
        Path(name).symlink_to(ROOT / name)
    # As they are now: whoever edits a test meanwhile makes the unchanged code fail, and mutmut then runs nothing.
    shutil.copytree(ROOT / "tests", "tests", ignore=shutil.ignore_patterns("__pycache__"))
    # Whole, as mutmut follows no links; without C, which would compute what the Python there was changed in.
    shutil.copytree(ROOT / "srl", "srl", ignore=shutil.ignore_patterns("__pycache__", "_compiled*"))
    for module in map(Path, modules):  # `zip` checks what is so anyway: no test can notice its end
        module.write_text(re.sub(r",\s*strict=True", "", module.read_text()))
    tests = list(dict.fromkeys(str(p.relative_to(ROOT)) for each in tests for p in sorted(ROOT.glob(each))))
    settings = {
        "source_paths": ["srl"],
        "only_mutate": modules,
        "also_copy": list(COPIED),
        "pytest_add_cli_args": ["-p", "no:xdist", "-p", "no:cacheprovider", "-m", "not slow and not serial"],
        "pytest_add_cli_args_test_selection": tests,
        "do_not_mutate_patterns": [r"raise \w+", r"\.report\(", r"nearest\("],  # words for people
        "timeout_multiplier": ["5"],
    }
    lines = [f"{key}=\n" + "".join(f"    {value}\n" for value in values) for key, values in settings.items()]
    Path("setup.cfg").write_text("[mutmut]\n" + "".join(lines))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("group", choices=GROUPS)
    for name, default in (("minutes", 10), ("sample", 60), ("seed", 0), ("jobs", 2)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--only", default="*", help="mutants whose names fit this: '*_stops_within*'")
    given = parser.parse_args()
    end = time.monotonic() + 60 * given.minutes
    prepare(given.group)
    output = mutmut("run", "--max-children", str(given.jobs), "none of them")  # makes all, runs the tests once
    every = [name for name, _ in statuses()]
    if "nothing matches" not in output or not every:
        sys.exit(output[-3000:])
    every = fnmatch.filter(every, given.only)
    chosen = random.Random(given.seed).sample(sorted(every), min(given.sample, len(every)))
    output = mutmut("run", "--max-children", str(given.jobs), *chosen, seconds=max(end - time.monotonic(), 1.0))
    results = dict(statuses())
    if chosen and all(results[name] == "not checked" for name in chosen) and time.monotonic() < end:
        sys.exit(output[-3000:])  # a test fails without a change
    found = {status: [name for name in chosen if results[name] == status] for status in sorted({*results.values()})}
    for name in found.get("survived", []) + found.get("no tests", []):
        lines = [line for line in mutmut("show", name).splitlines() if re.match(r"@@|[-+](?![-+])", line)]
        print(f"{name}: {results[name]}", *lines, "", sep="\n")
    print(f"{given.group}: {len(every)} mutants, {len(chosen)} chosen:", {k: len(v) for k, v in found.items() if v})


if __name__ == "__main__":
    if sys.argv[1:2] == ["--mutmut"]:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell runs in its background inherits none
        operators()
        from mutmut.__main__ import cli

        cli(sys.argv[2:])
    main()
