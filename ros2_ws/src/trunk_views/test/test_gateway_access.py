"""Who gets into the gateway: paths, hosts, tokens, origins, and how many pages at once."""

import asyncio

import pytest
from tornado.httpclient import HTTPClientError

from trunk_views.live.access import MOST_CLIENTS
from trunk_views.live.feed import NAME
from trunk_views.live.server import page_files

from .gateway_served import serving, words


def test_the_page_is_served_with_headers_that_let_nothing_in():
    async def test(served):
        for path in ("/", "/style.css", "/page.js", "/uPlot.iife.min.js"):
            found = await served.get(path)
            assert found.code == 200
            assert found.body == page_files()[path].data
            policy = found.headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy
            assert "unsafe" not in policy
            assert found.headers["X-Content-Type-Options"] == "nosniff"
            assert "Server" not in found.headers

    serving(test)


@pytest.mark.parametrize(
    "path",
    [
        "/../../../../etc/passwd",
        "/..%2f..%2fetc/passwd",
        "/%2e%2e/pyproject.toml",
        "//etc/passwd",
        "/vendor/LICENSE",
        "/index.html",
        "/report-.html",
        "/page.js/",
        "/\x00",
    ],
)
def test_paths_outside_the_page_do_not_exist(path):
    async def test(served):
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        writer.write(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\nConnection: close\r\n\r\n".encode()
        )
        answer = await reader.read()
        writer.close()
        assert answer.split()[1] in (b"404", b"400")
        assert b"root:" not in answer
        assert b"Traceback" not in answer

    serving(test)


def test_another_host_is_not_answered():
    async def test(served):
        found = await served.get("/", Host=f"evil.example:{served.port}")
        assert found.code == 403
        await served.until(lambda: served.gateway.refused["requests to another host"] == 1)

    serving(test)


_OTHERS = (
    *("", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:18081", "127.0.0.1:{port}", "localhost"),
    *("localhost:{port}", "localhost:18080.evil.example", "evil.example:18080", "0.0.0.0:18080"),
    *("[::1]:18080", "127.0.0.2:18080", "127.0.0.1.evil.example:18080", "127.1:18080"),
    *(
        "user@127.0.0.1:18080",
        "2130706433:18080",
        "127.0.0.1:018080",
        "evil.example, 127.0.0.1:18080",
    ),
    *("LOCALHOST.:18080", "robot:18080"),
)


def test_behind_another_port_only_the_address_that_browsers_open_is_known():
    async def test(served):
        for name in ("127.0.0.1:18080", "localhost:18080"):
            assert (await served.get("/", Host=name)).code == 200
            page = await served.connect(Host=name, Origin=f"http://{name}")
            assert (await words(page, "hello"))["control"]
        assert len(_OTHERS) == 20
        for other in (one.format(port=served.port) for one in _OTHERS):
            assert (await served.get("/", Host=other)).code in (400, 403), other
            with pytest.raises(HTTPClientError, match="403"):
                await served.connect(Host="127.0.0.1:18080", Origin=f"http://{other}")
        with pytest.raises(HTTPClientError, match="403"):
            await served.connect(Host="127.0.0.1:18080", Origin="https://127.0.0.1:18080")
        with pytest.raises(HTTPClientError, match="403"):
            await served.connect("x" * 43, Host="127.0.0.1:18080")

    serving(test, url="http://127.0.0.1:18080")


@pytest.mark.parametrize("token", ["", "x" * 43])
def test_nobody_gets_in_without_a_token(token):
    async def test(served):
        with pytest.raises(HTTPClientError, match="403"):
            await served.connect(token)
        assert served.gateway.refused == {"connections without the token": 1}
        assert not served.gateway.clients

    serving(test)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:1", "http://["]
)
def test_pages_of_another_origin_do_not_get_in(origin):
    async def test(served):
        with pytest.raises(HTTPClientError, match="403"):
            await served.connect(Origin=origin)
        assert served.gateway.refused == {"pages of another origin": 1}
        own = await served.connect(Origin=f"http://localhost:{served.port}")
        assert (await words(own, "hello"))["control"]
        assert own.selected_subprotocol == NAME  # the token is not repeated

    serving(test)


def test_a_watching_page_sees_everything_and_controls_nothing():
    async def test(served):
        page = await served.connect(served.tokens.watch)
        assert not (await words(page, "hello"))["control"]
        assert (await words(page, "stream"))["columns"] == ["t", "v"]
        page.write_message('{"kind": "reset", "number": 5}')
        answer = await words(page, "answer")
        assert (answer["number"], answer["ok"]) == (5, False)
        assert served.feed.asked == []
        assert served.gateway.refused == {"requests of pages that may only watch": 1}

    serving(test)


def test_watching_pages_leave_places_for_controlling_ones():
    async def test(served):
        while len(served.gateway.clients) < MOST_CLIENTS - 4:
            await served.connect(served.tokens.watch)
        with pytest.raises(HTTPClientError, match="503"):
            await served.connect(served.tokens.watch)
        assert (await words(await served.connect(), "hello"))["control"]

    serving(test)


def test_the_number_of_pages_is_limited():
    async def test(served):
        pages = [await served.connect() for _ in range(MOST_CLIENTS)]
        with pytest.raises(HTTPClientError, match="503"):
            await served.connect()
        pages[0].close()
        await served.until(lambda: len(served.gateway.clients) < MOST_CLIENTS)
        await served.connect()

    serving(test)
