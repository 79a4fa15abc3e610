"""`trunk report --serve`: a page for browsers elsewhere, and nothing else."""

import http.client
import re
import signal
import socket
import struct
import subprocess
import sys
from urllib.parse import urlsplit

import pytest

from .documents import checked

TRUNK = [sys.executable, "-c", "from trunk_experiments.executables import trunk; trunk()"]


@pytest.fixture
def served(short_run, tmp_path):
    """Yield a report that is served: its file, its address, and what the verb printed."""
    page = tmp_path / "page.html"
    process = subprocess.Popen(
        [*TRUNK, "report", short_run("fig8", "pid"), "-o", page, "--serve", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    words = process.stderr.readline() + process.stderr.readline()
    document = "".join(iter(process.stdout.readline, "}\n")) + "}\n"
    yield page, checked(document, "report-1")["address"], words
    process.send_signal(signal.SIGINT)
    assert process.communicate() == ("", "interrupted\n")
    assert process.returncode == 130


def answer(address, path=None, method="GET", **headers):
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname, parts.port)
    connection.request(method, parts.path if path is None else path, headers=headers)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def test_the_page_is_served_by_its_secret_path_alone(served):
    page, address, words = served
    assert words == f"page: {address}\nuntil Ctrl-C\n"
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/report-[\w-]{43}\.html", address)
    found, body = answer(address)
    assert (found.status, body) == (200, page.read_bytes())
    assert found.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert found.headers["Cache-Control"] == "no-store"
    path = urlsplit(address).path
    for other in (
        "/",
        "/report.html",
        path[:-6] + ".html",
        path + "?",
        "/../" + page.name,
        "*",
        "//",
    ):
        assert answer(address, other)[0].status == 404, other
    for host in ("evil.example", "127.0.0.1", ""):
        found, body = answer(address, Host=host)
        assert found.status == 403, host
        assert page.read_bytes() not in body
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert answer(address, method=method)[0].status == 501


def test_who_leaves_or_sends_nonsense_says_nothing_at_the_terminal(served):
    page, address, _ = served
    parts = urlsplit(address)
    for request in (
        f"GET {parts.path} HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n",
        "GET /\xff HTTP/1.1\r\n\r\n",
        "\x16\x03\x01 TLS\r\n\r\n",
        "GET\r\n",
        f"GET / HTTP/1.1\r\nHost: {'x' * 100_000}\r\n\r\n",
    ):
        for _ in range(5):
            with socket.create_connection((parts.hostname, parts.port)) as client:
                reset = struct.pack("ii", 1, 0)
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset)
                client.sendall(request.encode("latin-1"))
    assert answer(address)[1] == page.read_bytes()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--port", "8000"), "without --serve nothing is served: leave out --port"),
        (("--serve", "--host", "localhost"), "--host localhost: give one address of this machine"),
        (("--serve", "--host", "0.0.0.0"), "need --url, the address that browsers open"),
        (("--serve", "--url", "ftp://a"), "--url ftp://a: http://HOST:PORT"),
        (
            ("--serve", "--host", "192.0.2.1"),
            "address 192.0.2.1:0: Cannot assign requested address",
        ),
    ],
)
def test_mistakes_are_said_before_anything_is_written(trunk, short_run, tmp_path, words, line):
    page = tmp_path / "page.html"
    code, _, said = trunk("report", short_run("fig8", "pid"), "-o", page, *words)
    assert code in (1, 2)
    assert line in said
    assert said.count("\n") == 1
    assert not page.exists()


def test_the_page_is_opened_where_there_is_a_screen(trunk, short_run, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: not opened.append(address))
    for screen in ("", ":1"):
        monkeypatch.setenv("DISPLAY", screen)
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        page = tmp_path / f"page{screen}.html"
        code, _, said = trunk("report", short_run("fig8", "pid"), "-o", page, "--open")
        assert code == 0
        line = f"trunk: warning: --open: there is no browser here: open {page.as_uri()}\n"
        assert said == ("" if screen else line)
    assert opened == [page.as_uri()]
