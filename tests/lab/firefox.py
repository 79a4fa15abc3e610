"""Firefox, headless, driven by WebDriver BiDi: enough to open a page and evaluate expressions in it."""

from __future__ import annotations

import asyncio
import itertools
import json
import os
import shutil
import signal
import subprocess
from collections.abc import Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tornado.websocket import WebSocketClientConnection, websocket_connect

PROGRAM = os.environ.get("TRUNK_FIREFOX") or shutil.which("firefox-esr") or shutil.which("firefox")
_LARGEST = 1 << 28  # bytes of an answer


class Firefox:
    """A browser with one tab; as a context manager it ends its process."""

    def __init__(self, folder: Path) -> None:
        """Start it with a new profile in the folder."""
        self._loop = asyncio.new_event_loop()
        self._thread = ThreadPoolExecutor(1)  # Playwright's loop may be running in the caller's
        self._numbers = itertools.count(1)
        profile = folder / "profile"
        profile.mkdir()
        command = [str(PROGRAM), "--headless", "--no-remote", "--profile", str(profile)]
        self._process = subprocess.Popen(
            [*command, "--remote-debugging-port=0"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "HOME": str(folder), "MOZ_DISABLE_CONTENT_SANDBOX": "1"},
            start_new_session=True,
        )
        try:
            address = self._address()
            self._socket: WebSocketClientConnection = self._run(self._connect(f"{address}/session"))
            self.ask("session.new", capabilities={})
            self._tab = self.ask("browsingContext.create", type="tab")["context"]
        except BaseException:
            self.close()
            raise

    def _address(self) -> str:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if "WebDriver BiDi listening on " in line:
                return line.split(" on ")[1].strip()
        raise RuntimeError("Firefox ended before it said where it listens")

    @staticmethod
    async def _connect(address: str) -> WebSocketClientConnection:
        return await websocket_connect(address, max_message_size=_LARGEST)

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the result of a command. Raises RuntimeError with the browser's words."""
        result: dict[str, Any] = self._run(self._ask(method, parameters))
        return result

    def _run(self, coroutine: Coroutine[Any, Any, Any]) -> Any:
        return self._thread.submit(self._loop.run_until_complete, coroutine).result()

    async def _ask(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        number = next(self._numbers)
        await self._socket.write_message(
            json.dumps({"id": number, "method": method, "params": parameters})
        )
        while True:
            text = await self._socket.read_message()
            if text is None:
                raise RuntimeError(f"{method}: Firefox closed the connection")
            answer = json.loads(text)
            if answer.get("id") != number:
                continue  # an event
            if answer["type"] == "error":
                raise RuntimeError(f"{method}: {answer['message']}")
            result: dict[str, Any] = answer["result"]
            return result

    def open(self, address: str) -> None:
        """Open an address and wait until it is loaded."""
        self.ask("browsingContext.navigate", context=self._tab, url=address, wait="complete")

    def evaluate(self, expression: str) -> Any:
        """Return what an expression, or its promise, gives, as JSON. Raises RuntimeError if it throws."""
        result = self.ask(
            "script.evaluate",
            expression=f"(async () => JSON.stringify(await ({expression})))()",
            target={"context": self._tab},
            awaitPromise=True,
        )
        if result["type"] == "exception":
            raise RuntimeError(result["exceptionDetails"]["text"])
        value = result["result"].get("value")
        return None if value is None else json.loads(value)

    def point(self, actions: Sequence[tuple[Any, ...]]) -> None:
        """Use the mouse: ("move", x, y) in CSS pixels of the window, ("down",), ("up",)."""
        kinds = {"move": "pointerMove", "down": "pointerDown", "up": "pointerUp"}
        said = []
        for kind, *place in actions:
            more = dict(zip("xy", place, strict=True)) if place else {"button": 0}
            said.append({"type": kinds[kind], **more})
        source = {"type": "pointer", "id": "mouse", "actions": said}
        self.ask("input.performActions", context=self._tab, actions=[source])

    def close(self) -> None:
        """End the process with all its children."""
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        if self._process.stderr is not None:
            self._process.stderr.close()
        self._thread.shutdown()
        self._loop.close()

    def __enter__(self) -> Firefox:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
