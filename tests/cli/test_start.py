"""Every start of `srl` loads what all its commands need, and nothing that only some need."""

from __future__ import annotations

import subprocess
import sys

import pytest

from srl.commissioning.calibration.request import KINDS
from srl.commissioning.calibration.session import method_of
from srl.runtime.cli import COMMANDS, main, others

HEAVY = {"matplotlib", "mujoco", "rerun", "scipy", "zenoh"}  # each takes longer to load than the rest of a command


@pytest.mark.slow
def test_a_stop_a_check_and_a_show_without_a_simulation_load_none_of_them() -> None:
    code = (
        "import sys; from srl.runtime.cli import main; main(['stop', 'no-such']); main(['check', 'sixth-finger']); "
        "main(['show', 'sixth-finger']); "
        f"print('loaded:', *sorted({HEAVY} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=True)
    assert "no-such" in done.stderr
    assert done.stdout.splitlines()[-1] == "loaded:"


# What shows that more than the command line was loaded; pydantic and numpy come with the first part or profile.
_NEVER = HEAVY | {"aiohttp", "can", "numpy", "pinocchio", "pyarrow", "pydantic", "rich", "ruamel", "serial"}


@pytest.mark.parametrize("asked", ["--help", "--version", "list"])
def test_what_only_tells_loads_no_library(asked: str) -> None:
    code = (
        f"import sys\nfrom srl.runtime.cli import main\ntry:\n    main(['{asked}'])\nexcept SystemExit: pass\n"
        f"print('loaded:', *sorted({_NEVER} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=True)
    *reported, loaded = done.stdout.splitlines()
    assert reported
    assert loaded == "loaded:"


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    reported = capsys.readouterr().out
    assert all(f"\n    {name}" in reported for name in (*COMMANDS, *others.commands()))


def test_every_command_is_registered_by_its_module(capsys: pytest.CaptureFixture[str]) -> None:
    for name in (*COMMANDS, *others.commands()):
        with pytest.raises(SystemExit) as ended:
            main([name, "--help"])
        assert ended.value.code == 0
        assert f"srl {name}" in capsys.readouterr().out


def test_the_laws_that_can_be_calibrated_are_named() -> None:
    assert tuple(method_of(law).name for law in KINDS) == KINDS


@pytest.mark.slow
def test_a_calibration_loads_no_other_one() -> None:
    code = (
        "import sys; from srl.commissioning.calibration.session import method_of; method_of('glove'); "
        "methods = [name for name in sys.modules if name.startswith('srl.commiss') and name.endswith('.method')]; "
        "print(*(name for name in methods if name.count('.') == 4))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=True)
    assert done.stdout.split() == ["srl.commissioning.calibration.glove.method"]
