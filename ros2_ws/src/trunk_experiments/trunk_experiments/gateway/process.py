"""The gateway's process, from the verb's side: start, restart, send, receive, end."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from ..errors import GatewayError
from .access import Tokens

LOOPBACK = "127.0.0.1"
_ENDS_S = 5.0
_RESTARTS = 5  # in a row
_LASTS_S = 10.0  # after running for longer than this, restarts are counted from zero


class GatewayProcess:
    """A process of its own, which can neither slow nor stop a run; it ends when this one does.

    This process keeps the socket and the tokens, so a restarted gateway has the same address.
    """

    def __init__(
        self, log: Path, host: str, port: int, shown: Mapping[str, object], url: str = ""
    ) -> None:
        """Start serving ``shown``; browsers reach it at ``url``, empty: at host and port themselves.

        Raises GatewayError where the address cannot be used.
        """
        self._log = log
        self._socket = _listening(host, port)
        self.port: int = self._socket.getsockname()[1]
        self.tokens = Tokens.new()
        name = f"[{host}]" if ":" in host else host
        self._url = url or f"http://{name}:{self.port}"
        self._told: list[str] = [
            json.dumps(
                {
                    **shown,
                    "tokens": self.tokens,
                    "socket": self._socket.fileno(),
                    "url": self._url,
                }
            )
        ]
        self._heard = b""
        self._restarts = 0
        self._process = self._start()

    def address(self, token: str) -> str:
        """Return the page's address; browsers neither send nor log what follows ``#``."""
        return f"{self._url}/#{token}"

    def turn(self) -> list[str]:
        """Return the gateway's messages; start it again if it has ended. Raises GatewayError."""
        heard = self._hear()
        if self._process.poll() is not None:
            if time.monotonic() - self._since_s > _LASTS_S:
                self._restarts = 0
            if self._restarts == _RESTARTS:
                last = self._log.read_text("utf-8", "replace").strip().splitlines()[-1:]
                raise GatewayError(f"the gateway exits each time it is started: {''.join(last)}")
            self._restarts += 1
            self._close_pipes()
            self._process = self._start()
        return heard

    def tell(self, **values: object) -> None:
        """Send these values to the gateway, and to each one that is started later."""
        self._told.append(json.dumps(values))
        self._send(self._told[-1])

    @property
    def pid(self) -> int:
        """The process's id."""
        return self._process.pid

    def close(self) -> None:
        """End the gateway."""
        with suppress(OSError):
            assert self._process.stdin is not None
            self._process.stdin.close()  # that ends it
        try:
            self._process.wait(_ENDS_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._close_pipes()
        self._socket.close()

    def _start(self) -> subprocess.Popen[bytes]:
        with self._log.open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "trunk_experiments.gateway.main"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                pass_fds=[self._socket.fileno()],
                start_new_session=True,  # Ctrl-C reaches the verb alone
            )
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        self._process, self._heard, self._since_s = process, b"", time.monotonic()
        for line in self._told:
            self._send(line)
        return process

    def _send(self, line: str) -> None:
        with suppress(OSError):  # it has ended: the next one is told
            assert self._process.stdin is not None
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()

    def _hear(self) -> list[str]:
        assert self._process.stdout is not None
        with suppress(OSError):
            self._heard += self._process.stdout.read() or b""
        *lines, self._heard = self._heard.split(b"\n")
        return [line.decode() for line in lines]

    def _close_pipes(self) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                assert pipe is not None
                pipe.close()


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(128)
    except (OSError, OverflowError) as error:
        listener.close()
        reason = getattr(error, "strerror", None) or str(error)
        raise GatewayError(
            f"address {host}:{port}: {reason}: give another with --host or --port"
        ) from None
    return listener
