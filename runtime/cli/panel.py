"""`srl panel`: a page in the browser of a running instance: the operator's panel, or the participant's screen."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from pathlib import Path

import numpy as np

from srl.runtime.cli import add_command, options
from srl.runtime.cli.instance import choose
from srl.runtime.contracts.errors import HostError, RequestError
from srl.runtime.web.operator.client import OperatorPage
from srl.runtime.web.panel import again
from srl.runtime.web.panel.client import PageProcess
from srl.runtime.web.panel.screen import Screen
from srl.runtime.web.panel.trial import ScreenTrial, Trial

TRIALS = 3
SECONDS = 25.0
REST = 5.0  # s between the demonstration's trials


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(
        subparsers, "panel", "srl panel human-srl",
    )  # fmt: skip
    options.instance(parser)
    parser.add_argument(
        "--signal", metavar="SIGNAL",
        help="the participant's screen with this control value, one number of the loop's rows",
    )  # fmt: skip
    parser.add_argument(
        "--span", type=float, nargs=2, metavar=("LOW", "HIGH"),
        help="values of the signal that are shown as 0 and 100; default: 0 1",
    )  # fmt: skip
    parser.add_argument("--held", metavar="SIGNAL", help="a signal that isn't zero while the value is held")
    parser.add_argument("--web-port", type=int, default=0, metavar="N", help="on 127.0.0.1; default: any free one")
    options.renamed(parser, "--port", "--web-port")
    parser.add_argument(
        "--recordings", type=Path, metavar="FOLDER", help="whose recordings the panel lists; default: this one"
    )
    parser.add_argument(
        "--again", action="store_true",
        help="new addresses of the pages that are there, `run --view`'s too, for another browser; then it ends",
    )  # fmt: skip
    parser.add_argument("--demo", action="store_true", help=f"{TRIALS} trials to try the screen")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="with --demo: stores the trials there")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serves until Ctrl-C, or until the demonstration is over."""
    if args.again:
        return _again(args)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # as a page that nobody needs any more ends
    if args.signal is None:
        for option, given in _of_the_screen(args):
            if given:
                problem = "it is for the participant's screen"
                raise RequestError(option, problem, "Add --signal, or leave it out for the panel")
    elif args.recordings is not None:
        raise RequestError("--recordings", "the participant's screen lists none", "Leave it out, or --signal")
    low, high = args.span or (0.0, 1.0)
    if not np.isfinite([low, high]).all() or low == high:
        raise RequestError("--span", "it needs two different numbers", "For example: --span 0 1")
    if not 0 <= args.web_port <= 65535:
        raise RequestError("--web-port", f"{args.web_port} is no port", "Leave it out for any free one")
    if args.out is not None and not args.demo:
        raise RequestError("--out", "there are no trials to store", "Add --demo")
    if args.signal is None:
        with OperatorPage(choose(args.instance), args.recordings, args.web_port) as page:
            print(f"Open this once, in a browser on this machine (Ctrl-C ends):\n  {page.address}", flush=True)
            return _wait(page)
    with Screen(choose(args.instance), args.signal, (low, high), args.held, args.web_port) as screen:
        print(f"Open this once, in the participant's browser (Ctrl-C ends):\n  {screen.address}", flush=True)
        if not args.demo:
            return _wait(screen)
        for number in range(1, TRIALS + 1):
            while not _one(screen, number, args.out):
                pass
    return 0


def _again(args: argparse.Namespace) -> int:
    given = {"--web-port": args.web_port or None, "--recordings": args.recordings, "--signal": args.signal}
    for option, value in [*given.items(), *_of_the_screen(args)]:
        if value:
            raise RequestError(option, "the pages are there already, as they were started", "Leave it out, or --again")
    folder = choose(args.instance)
    found = again.ask(folder)
    if not found:
        name = folder.path.name
        raise RequestError(f"instance '{name}'", "no page of it is served", f"Start one: srl panel {name}")
    print("Each is good once. The browser that opens it is the only one from then on:")
    for page, address in found:
        print(f"{page}:\n  {address}")
    return 0


def _of_the_screen(args: argparse.Namespace) -> list[tuple[str, bool]]:
    """Options of the participant's screen alone, and whether each is given."""
    given = {"--span": args.span, "--held": args.held, "--demo": args.demo or None, "--out": args.out}
    return [(option, value is not None) for option, value in given.items()]


def _wait(page: PageProcess) -> int:
    """Waits for Ctrl-C. Raises HostError: the page's process has ended."""
    while page.alive:
        time.sleep(0.2)
    raise HostError("srl panel", "the page's process has ended", "Start it again")


def _one(screen: Screen, number: int, out: Path | None) -> bool:
    """Runs one trial and says what came of it. Returns whether it counts."""
    rest = REST if number > 1 else 0.0
    done = screen.run_trial(
        Trial(demo_curve(number), SECONDS, rest=rest, title="Demonstration", number=number, of=TRIALS)
    )
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
            done.save(out / f"trial-{number}{'-aborted' if done.aborted else ''}")
        except OSError as error:
            raise HostError(str(out), f"the trial can't be stored: {error.strerror}", "Give another --out") from None
    print(f"trial {number}: {_words(done)}", flush=True)
    return not done.aborted


def _words(done: ScreenTrial) -> str:
    if done.aborted:
        return f"broken off: {done.aborted}"
    error = 100 * float(np.sqrt(np.nanmean((done.samples[:, 1] - done.samples[:, 2]) ** 2)))
    timing = done.timing
    score = f"RMSE {error:.2f} of 100 over {len(done.samples)} rows"
    if "interval_p50" in timing:
        score += f"; {1 / timing['interval_p50']:.1f} frames/s, {100 * timing['missed']:.1f} % missed"
    return score


def demo_curve(number: int) -> tuple[float, ...]:
    """A smooth curve that begins flat, faster with each trial; (501,), 0..1."""
    t = np.linspace(0.0, SECONDS, 501)
    swing = 0.28 * np.sin(0.35 * number * t) + 0.14 * np.sin(0.9 * number * t)
    rise = np.clip((t - 1.5) / 2.0, 0.0, 1.0)
    curve = 0.5 + swing * rise**2 * (3.0 - 2.0 * rise)
    return tuple(curve.tolist())
