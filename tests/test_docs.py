"""The pages say what the code does: links, command lines, profile keys, devices, and the example package."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import pty
import re
import shlex
import subprocess
import sys
import threading
import tty
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.lever import write_installed
from helpers.run import call, environment
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from srl.runtime.cli import MODULES, others
from srl.runtime.cli.check import check_guards
from srl.runtime.contracts import registry
from srl.runtime.profile import profile, wiring
from srl.sim.devices.examples import DEVICES

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [*(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")), *sorted(DOCS.rglob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
name = lambda page: str(page.relative_to(ROOT))  # noqa: E731


# Links


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page: Path) -> None:
    text = FENCE.sub("", page.read_text())
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        if not re.match(r"https?://|mailto:", target):
            assert (page.parent / target).exists(), f"{name(page)} links to {target}"


def test_every_page_is_linked_from_the_readme_or_its_folder() -> None:
    readme = (ROOT / "README.md").read_text()
    for page in DOCS.glob("*.md"):
        assert f"(docs/{page.name})" in readme, page.name


# Command lines


@pytest.fixture(scope="module")
def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="srl", exit_on_error=False)
    subparsers = parser.add_subparsers(required=True)
    for command in dict.fromkeys(MODULES.values()):
        importlib.import_module(f"srl.runtime.cli.{command}").add_parser(subparsers)
    for name, modules in others.commands().items():
        others.load(name, modules).add_parser(subparsers, name)
    return parser


def command_lines(page: Path) -> Iterator[str]:
    """Each `srl ...` that a reader may type: lines of fenced text blocks, and inline code."""
    text = page.read_text()
    code = [line for kind, body in FENCE.findall(text) if kind in ("", "sh", "ini") for line in body.splitlines()]
    code += re.findall(r"`([^`\n]+)`", FENCE.sub("", text))
    for line in code:
        for part in line.split("#")[0].split(" | "):
            if match := re.search(r"^(?:.*[/ ])?srl ([a-z].*)$", part.rstrip(" '")):
                yield match[1]


def as_typed(line: str) -> list[str]:
    """Placeholders filled in: optional parts and what systemd expands left out, numbers for S."""
    line = re.sub(r"\[[A-Z][^\]]*\]|\$?\$\(.*\)", "", line)
    words = shlex.split(re.sub(r"\$\{?(\w+)\}?", r"\1", line).replace("SRL_OPTIONS", ""))
    return ["1" if word == "S" else word for word in words if word not in (">", "srl.json")]


def parses(parser: argparse.ArgumentParser, line: str) -> bool:
    """Whether srl takes it; a mention such as `srl run --json` may leave out its subject, of one word or two."""
    for more in ([], ["sixth-finger"], ["folder", "name"]):
        try:
            parser.parse_args(as_typed(line) + more)
        except (SystemExit, argparse.ArgumentError):
            continue
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_command_lines_parse(page: Path, parser: argparse.ArgumentParser) -> None:
    for line in command_lines(page):
        assert parses(parser, line), f"{name(page)}: srl {line}"


def test_wrong_command_lines_would_be_noticed(tmp_path: Path, parser: argparse.ArgumentParser) -> None:
    assert sum(len(list(command_lines(page))) for page in PAGES) > 30
    page = tmp_path / "page.md"
    page.write_text(
        "Use `srl run x --simulate`.\n\n```\nsudo /opt/srl/bin/srl stopp x   # no\nsrl check x | srl go\n```\n"
    )
    found = list(command_lines(page))
    assert found == ["stopp x", "check x", "go", "run x --simulate"]
    assert [parses(parser, line) for line in found] == [False, True, False, False]


# profiles.md


def models(annotation: Any) -> Iterator[tuple[type[BaseModel], str]]:
    """The models within a field's type, and what stands between the field's name and theirs."""
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, ""
    elif origin is dict:
        yield from ((model, f".<name>{rest}") for model, rest in models(inner[1]))
    elif origin is tuple:
        yield from ((model, f"[]{rest}") for model, rest in models(inner[0]))
    elif origin in (typing.Union, types.UnionType):
        for one in inner:
            yield from models(one)


def keys(model: type[BaseModel], prefix: str = "") -> dict[str, Any]:
    """Every key's default, by its path."""
    found: dict[str, Any] = {}
    for field_name, field in model.model_fields.items():
        path = prefix + (field.alias or field_name)
        below = list(models(field.annotation))
        for inner, between in below:
            found |= keys(inner, f"{path}{between}.")
        if not below:
            found[path] = field.get_default(call_default_factory=True)
    return found


def documented() -> dict[str, str]:
    """Key path: what the table says of its default."""
    text = (DOCS / "profiles.md").read_text()
    return dict(re.findall(r"^\| `([^`]+)` \| ([^|]*?) \|", text, re.MULTILINE))


def test_profiles_page_has_every_key_and_no_other() -> None:
    assert set(documented()) == set(keys(profile.Profile))


def test_profiles_page_has_the_defaults() -> None:
    output = documented()
    for path, default in keys(profile.Profile).items():
        text = output[path].strip("`")
        if default is PydanticUndefined:
            assert text == "required", path
        elif default is None:
            assert text in ("none", "the driver's", "the law's"), path
        elif default in ("", (), {}):
            assert text == "empty", path
        elif isinstance(default, str):
            assert text == default, path
        elif isinstance(default, bool):
            assert text == str(default).lower(), path
        elif isinstance(default, int | float):
            assert float(text) == default, path
        else:
            written = str(list(default) if isinstance(default, tuple) else default)
            assert text == re.sub(r"\.0(?!\d)", "", written), path


def test_profiles_pages_example_is_right() -> None:
    text, choices = (body for kind, body in FENCE.findall((DOCS / "profiles.md").read_text()) if kind == "yaml")
    nothing: list[str] | None = None
    for content, words in ((text, ()), (text + choices, ()), (text + choices, ("input=ring",))):
        checked, source = profile.parse("one-servo.yaml", content, words)
        for simulated in (nothing, []):
            graph = wiring.build(checked, source, simulated)
            assert check_guards(graph) == {"board.position_command": "hold"}
            assert {d.name for d in graph.devices} == {"board", *(["ring"] if words else [])}


def test_every_override_on_the_profiles_page_works(parser: argparse.ArgumentParser) -> None:
    for line in command_lines(DOCS / "profiles.md"):
        args = parser.parse_args(as_typed(line))
        if getattr(args, "profile", "") == "sixth-finger":
            checked, source = profile.load("sixth-finger", args.set)
            wiring.build(checked, source, [])


# Pages for people


@pytest.mark.parametrize("driver", [name for name in registry.names("drivers") if name != "lever"])
def test_each_driver_has_a_page(driver: str) -> None:
    page = (DOCS / "devices" / f"{driver}.md").read_text()
    assert f"driver: {driver}" in page


# extending.md


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page's package, as if it were installed: its files, and its entry points."""
    folder = tmp_path_factory.mktemp("lever")
    assert write_installed(folder)["tool"]["setuptools"]["packages"] == ["srl_lever"]
    return folder


@pytest.fixture
def installed(package: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PYTHONPATH", f"{package}{os.pathsep}{ROOT}")
    return package


def test_the_example_is_listed(installed: Path) -> None:
    found = json.loads(call(installed, "list", "--json").stdout)
    lever = next(d for d in found["drivers"] if d["name"] == "lever")
    assert (lever["fake"], lever["states"]) == (True, ["position"])
    assert "lever-to-joint" in [c["name"] for c in found["controllers"]]


@pytest.mark.slow
def test_the_examples_command_asks_a_lever(installed: Path) -> None:
    master, slave = pty.openpty()
    tty.setraw(master)
    ended = threading.Event()

    def print_lines() -> None:
        while not ended.wait(0.01):
            os.write(master, b"512\n")

    printing = threading.Thread(target=print_lines)
    printing.start()
    try:
        assert call(installed, "lever", os.ttyname(slave)).stdout == "0.751 rad\n"
    finally:
        ended.set()
        printing.join()
        os.close(master)
        os.close(slave)


@pytest.mark.slow
def test_the_examples_own_tests_pass(installed: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_lever.py"],
        cwd=installed, env=os.environ, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert "28 passed, 2 skipped" in done.stdout


@pytest.mark.slow
def test_the_example_runs_moves_and_replays(installed: Path) -> None:
    assert "lever.position" in call(installed, "check", "lever.yaml").stdout
    call(
        installed,
        "run",
        "lever.yaml",
        "--sim",
        "--fast",
        "--duration",
        "6",
        "--set",
        "bus=null",
        "--record",
        "l.rrd",
    )
    code = (
        "import sys; from pathlib import Path; from srl.runtime.recording.reader import read; import numpy as np\n"
        "r = read(Path(sys.argv[1])); q = r.value('finger.position_command.applied')[:, 0]\n"
        "asked = r.value('finger.position_command')[:, 0]; on = r.int('state') == 2\n"
        "print(np.ptp(r.value('lever.position')), np.ptp(q), abs(asked[on][0] - q[on][0]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "l.rrd"], cwd=installed, env=environment(installed),
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    lever, moved, jump = map(float, done.stdout.split())
    assert lever > 0.5  # the simulated finger pressed it
    assert moved == pytest.approx(0.5 * lever, rel=0.2)
    assert jump < 0.05  # the first command is what was applied
    assert json.loads(call(installed, "replay", "l.rrd", "--json").stdout)["identical"] is True


# The rooms


def test_every_path_a_page_names_is_there() -> None:
    """Paths of modules and folders, as `runtime/loop/loop.py` or `drivers/zenoh_link`."""
    path = re.compile(r"`((?:runtime|drivers|sim|srl|studies|bench|tests|deploy|profiles)/[\w./-]*)`")
    pages = [ROOT / "README.md", *DOCS.rglob("*.md")]
    wrong = [
        f"{page.name}: {name}"
        for page in pages
        for name in path.findall(page.read_text())
        if not (ROOT / name).exists()
    ]
    assert wrong == []


# The guard's page


def test_the_guards_page_has_each_commands_period() -> None:
    """docs/guard.md, "What was sent": a row for each device that takes commands, with the period it declares."""
    rows = re.findall(r"^\| ([\w -]+) \| ([\w, ]+) \| ([^|]+) \| ([^|]+) \|$", (DOCS / "guard.md").read_text(), re.M)
    table = {
        device.lower(): (kinds.split(", "), period) for device, kinds, period, _ in rows if re.search(r"\d", period)
    }
    for driver_name, (config, _, _, port) in DEVICES.items():
        cls = registry.load("drivers", driver_name, "test")
        for command in cls(driver_name, cls.Config.model_validate({"port": port} | config)).commands:
            kinds, period = table[driver_name]
            assert ("effort" if driver_name == "dynamixel" and command.kind == "torque" else command.kind) in kinds
            assert f"{command.period:g}" in period, f"{driver_name}: {command.period} is not in '{period}'"


def test_each_page_is_in_the_sites_side_bar_once():
    spec = importlib.util.spec_from_file_location("docs_conf", ROOT / "docs" / "conf.py")
    assert spec is not None
    assert spec.loader is not None
    conf = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(conf)
    listed = [page for pages in conf.GROUPS.values() for page in pages]
    assert sorted(listed) == sorted(page.stem for page in (ROOT / "docs").glob("*.md"))
