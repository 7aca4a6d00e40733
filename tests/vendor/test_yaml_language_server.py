"""Red Hat's YAML language server, which editors run, reads a profile by our schema and underlines what is wrong."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from simavr.board import CACHE

from srl.runtime.profile import library
from srl.runtime.profile.schema import schema

SERVER = "yaml-language-server@1.25.0"

pytestmark = pytest.mark.slow


def installed() -> Path:
    """The server's program, fetched once; skips the test where it can't be had."""
    folder = CACHE / "yaml-language-server"
    program = folder / "node_modules" / ".bin" / "yaml-language-server"
    if not program.exists():
        if not shutil.which("npm"):
            pytest.skip(f"no npm to fetch {SERVER}")
        folder.mkdir(parents=True, exist_ok=True)
        command = ["npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(folder), SERVER]
        done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
        if done.returncode:
            pytest.skip(f"npm can't fetch {SERVER}: {done.stderr.strip()[-200:]}")
    return program


class Server:
    """The server, spoken to as an editor does: messages of the language server protocol on its pipes."""

    def __init__(self) -> None:
        self.process = subprocess.Popen([str(installed()), "--stdio"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def send(self, **message: Any) -> None:
        content = json.dumps({"jsonrpc": "2.0", **message}).encode()
        assert self.process.stdin is not None
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n" % len(content) + content)
        self.process.stdin.flush()

    def receive(self) -> dict[str, Any]:
        out, length = self.process.stdout, 0
        assert out is not None
        while line := out.readline().strip():
            name, _, value = line.partition(b":")
            length = int(value) if name.lower() == b"content-length" else length
        found: dict[str, Any] = json.loads(out.read(length))
        return found

    def problems(self, text: str) -> list[tuple[int, str]]:
        """(line, words) of each problem of a file with this text."""
        self.send(id=1, method="initialize", params={"processId": None, "rootUri": None, "capabilities": {
            "workspace": {"configuration": True}}})  # fmt: skip
        while True:
            said = self.receive()
            if said.get("id") == 1 and "result" in said:
                document = {"uri": "file:///profile.yaml", "languageId": "yaml", "version": 1, "text": text}
                self.send(method="initialized", params={})
                self.send(method="textDocument/didOpen", params={"textDocument": document})
            elif said.get("method") == "workspace/configuration":
                self.send(id=said["id"], result=[{} for _ in said["params"]["items"]])
            elif said.get("method") == "textDocument/publishDiagnostics":
                found = said["params"]["diagnostics"]
                return [(each["range"]["start"]["line"], each["message"]) for each in found]
            elif "id" in said and "method" in said:
                self.send(id=said["id"], result=None)


@pytest.fixture
def server() -> Any:
    made = Server()
    yield made
    made.process.kill()
    made.process.communicate()


def text(tmp_path: Path, *changes: tuple[str, str]) -> str:
    """human-srl with changes, and the line that names the schema, as docs/profiles.md says."""
    (tmp_path / "srl.json").write_text(json.dumps(schema()))
    made = library.files()["human-srl"].read_text(encoding="utf-8")
    for old, new in changes:
        assert old in made
        made = made.replace(old, new, 1)
    return f"# yaml-language-server: $schema=file://{tmp_path}/srl.json\n{made}"


@pytest.mark.timeout(300)
def test_an_editor_finds_nothing_wrong_with_a_shipped_profile(server: Server, tmp_path: Path) -> None:
    assert server.problems(text(tmp_path)) == []


@pytest.mark.timeout(300)
def test_an_editor_underlines_a_misspelt_option_and_an_unknown_law(server: Server, tmp_path: Path) -> None:
    found = server.problems(text(tmp_path, ("least: 0.02", "laest: 0.02"), ("use: reach ", "use: raech ")))
    words = " ".join(message for _, message in found)
    assert "laest" in words
    assert "arm-reach" in words  # the laws that there are
