"""Who is let in to the operator's panel: nobody but the browser that had the token."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from helpers.operated import OperatedLoop
from helpers.operator_page import UPGRADE, cookie, get, place

from runtime.operator.client import OperatorPage


@pytest.mark.parametrize("path", ["/", "/operator.js", "/pad.js", "/part.js", "/operator.css", "/socket", "/?token=x"])
def test_without_the_token_nothing_is_served(page: OperatorPage, path: str) -> None:
    assert get(page, path).status == 403


@pytest.mark.parametrize("origin", [None, "null", "http://example.org", "http://localhost", "https://127.0.0.1"])
def test_a_foreign_page_can_neither_listen_nor_stop(loop: OperatedLoop, page: OperatorPage, origin: str | None) -> None:
    headers = {"Cookie": cookie(page)} | ({"Origin": origin} if origin else {})
    stops = loop.stops
    assert get(page, "/socket", **headers, **UPGRADE).status == 403
    assert get(page, "/stop", "POST", **headers).status == 403
    assert loop.stops == stops


@pytest.mark.parametrize("host", ["rebound.example.org", "localhost", "127.0.0.1", "[::1]"])
def test_another_name_for_this_host_is_refused(page: OperatorPage, host: str) -> None:
    kept, origin = cookie(page), f"http://{place(page)}"
    assert get(page, "/", Cookie=kept, Host=host).status in (400, 421)
    assert get(page, "/socket", Cookie=kept, Host=host, Origin=origin, **UPGRADE).status in (400, 421)
    assert get(page, "/stop", "POST", Cookie=kept, Host=host, Origin=origin).status in (400, 421)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_another_users_process_is_refused(loop: OperatedLoop, page: OperatorPage) -> None:
    cookie(page)  # a browser is in
    script = """
import encodings.idna, http.client, json, os, sys
os.setgid(65534), os.setuid(65534)
place, upgrade = sys.argv[1], json.loads(sys.argv[2])
found = []
for method, path, more in (("GET", "/", {}), ("GET", "/socket", upgrade), ("POST", "/stop", {})):
    connection = http.client.HTTPConnection(place, timeout=20)
    connection.request(method, path, headers={"Origin": "http://" + place} | more)
    found.append(connection.getresponse().status)
print(found)
for path in (sys.argv[3], sys.argv[3] + "/press.sock", sys.argv[3] + "/loop.sock"):
    print(os.access(path, os.W_OK))
"""
    os.chmod(loop.folder.path, 0o750)  # as a run claims it
    command = [sys.executable, "-c", script, place(page), json.dumps(UPGRADE), str(loop.folder.path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split("\n")[:4] == ["[403, 403, 403]", "False", "False", "False"]
