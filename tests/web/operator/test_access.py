"""Who is let in to the operator's panel: nobody but the browser that had the token."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from helpers.operated import OperatedLoop
from helpers.operator_page import UPGRADE, asked, cookie, get, place

from srl.runtime.web.operator.client import OperatorPage


@pytest.mark.parametrize("path", ["/", "/operator.js", "/pad.js", "/part.js", "/operator.css", "/socket", "/?token=x"])
def test_without_the_token_nothing_is_served(page: OperatorPage, path: str) -> None:
    assert get(page, path).status == 403


@pytest.mark.parametrize("origin", [None, "null", "http://example.org", "http://localhost", "https://127.0.0.1"])
def test_a_foreign_page_can_neither_listen_nor_stop(loop: OperatedLoop, page: OperatorPage, origin: str | None) -> None:
    headers = cookie(page) | ({"Origin": origin} if origin else {})
    stops = loop.stops
    assert get(page, "/socket", **headers, **UPGRADE).status == 403
    assert get(page, "/stop", "POST", **headers).status == 403
    assert loop.stops == stops


@pytest.mark.parametrize("key", ["", "x", "cookie"])
def test_the_cookie_alone_is_worth_nothing(loop: OperatedLoop, page: OperatorPage, key: str) -> None:
    """A browser shows it to whoever serves another port of this host, so that another user may know it."""
    kept, origin, stops = cookie(page), f"http://{place(page)}", loop.stops
    key = kept["Cookie"].partition("=")[2] if key == "cookie" else key
    known = {"Cookie": kept["Cookie"], "Origin": origin}
    shows = {"X-Srl-Key": key, "Sec-WebSocket-Protocol": f"srl, {key}"} if key else {}
    assert get(page, "/socket", **known, **shows, **UPGRADE).status == 403
    assert get(page, "/stop", "POST", **known, **shows).status == 403
    assert loop.stops == stops
    assert kept["X-Srl-Key"] not in asked(page, "/", "GET", **known)[1]  # loaded again, the page doesn't hold it
    kept["Cookie"] = "srl-panel=overwritten"  # a page of another port can do that
    assert get(page, "/socket", Origin=origin, **kept, **UPGRADE).status == 101
    assert get(page, "/stop", "POST", Origin=origin, **kept).status == 200
    assert loop.stops == stops + 1


@pytest.mark.parametrize("host", ["rebound.example.org", "localhost", "127.0.0.1", "[::1]"])
def test_another_name_for_this_host_is_refused(page: OperatorPage, host: str) -> None:
    kept, origin = cookie(page), f"http://{place(page)}"
    assert get(page, "/", **kept, Host=host).status in (400, 421)
    assert get(page, "/socket", **kept, Host=host, Origin=origin, **UPGRADE).status in (400, 421)
    assert get(page, "/stop", "POST", **kept, Host=host, Origin=origin).status in (400, 421)


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
