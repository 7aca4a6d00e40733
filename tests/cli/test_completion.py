"""What the TAB key offers in a shell, asked in the shell's own way and in bash and zsh themselves."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import argcomplete
import pytest
from helpers.completion import offered

from srl.runtime.contracts import registry
from srl.runtime.profile import library

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_commands_and_their_options_are_offered(tmp_path: Path) -> None:
    assert offered("srl re", tmp_path) == {"recordings", "replay", "reset"}
    assert offered("srl run sixth-finger --f", tmp_path) == {"--fast", "--figure", "--foxglove"}


def test_a_profile_is_offered_by_its_name_and_as_a_file(tmp_path: Path) -> None:
    (tmp_path / "sixth-mine.yaml").touch()
    (tmp_path / "sixth-notes.txt").touch()
    shipped = {name for name in library.shipped() if name.startswith("sixth")}
    assert shipped
    assert offered("srl check sixth", tmp_path) == shipped | {"sixth-mine.yaml"}


def test_what_a_new_profile_begins_as_is_offered(tmp_path: Path) -> None:
    (tmp_path / "sixth-mine.yaml").touch()
    assert offered("srl new mine --from sixth", tmp_path) == {"sixth-finger"}


def test_studies_are_offered_by_name(tmp_path: Path) -> None:
    assert offered("srl study ", tmp_path) >= set(registry.names("studies"))


_BASH = """
eval "$(register-python-argcomplete srl)"
COMP_LINE="srl exp"; COMP_POINT=7; COMP_WORDS=(srl exp); COMP_CWORD=1; COMP_TYPE=9
_python_argcomplete srl exp srl
printf '%s\\n' "${COMPREPLY[@]}"
"""
# A terminal of its own, as zsh completes only where one types.
_ZSH = """
zmodload zsh/zpty
zpty -b shell zsh -f -i
zpty -w shell 'autoload -U compinit; compinit -u -D; eval "$(register-python-argcomplete srl)"; PS1=ready'
zpty -r shell said '*ready*ready'
zpty -w -n shell $'srl exp\\t'
zpty -r shell said '*export*'
print -r -- $said
zpty -d shell
"""


@pytest.mark.slow
@pytest.mark.parametrize(("shell", "script"), [("bash", _BASH), ("zsh", _ZSH)])
def test_a_shell_that_has_switched_it_on_completes(shell: str, script: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} isn't installed here")
    package = Path(argcomplete.__file__).parents[1]
    for name, module in (
        ("srl", "srl"),
        ("register-python-argcomplete", "argcomplete.scripts.register_python_argcomplete"),
    ):
        command = tmp_path / name
        start = f"import runpy; runpy.run_module('{module}', run_name='__main__', alter_sys=True)"
        command.write_text(f"#!{sys.executable}\n# PYTHON_ARGCOMPLETE_OK\n{start}\n")
        command.chmod(0o755)
    paths = os.pathsep.join([str(ROOT), str(package), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHONPATH": paths}
    done = subprocess.run(
        [shell, "-c", script], check=False, env=environment, capture_output=True, text=True, timeout=100
    )
    assert "export" in done.stdout, done.stderr
