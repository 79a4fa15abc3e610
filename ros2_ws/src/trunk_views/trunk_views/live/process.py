"""The gateway's process, from the verb's side: start, send, receive, end."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from trunk_core.errors import GatewayError

from .access import Tokens

LOOPBACK = "127.0.0.1"
_ENDS_S = 5.0


class GatewayProcess:
    """A process of its own, which can neither slow nor stop a run; it ends when this one does."""

    def __init__(
        self, log: Path, host: str, port: int, shown: Mapping[str, object], url: str = ""
    ) -> None:
        """Start serving ``shown``; browsers reach it at ``url``, empty: at host and port themselves.

        Raises GatewayError where the address cannot be used.
        """
        self._log = log
        self._heard = b""
        self.tokens = Tokens.new()
        with listening(host, port) as listener, log.open("wb") as output:
            self.port: int = listener.getsockname()[1]
            self._url = url or url_of(listener)
            self._process = subprocess.Popen(
                [sys.executable, "-m", "trunk_views.live"],
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=output,
                pass_fds=[listener.fileno()],
                start_new_session=True,  # Ctrl-C reaches the verb alone
            )
            self.tell(**shown, tokens=self.tokens, socket=listener.fileno(), url=self._url)
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)

    def address(self, token: str) -> str:
        """Return the page's address; browsers neither send nor log what follows ``#``."""
        return f"{self._url}/#{token}"

    def words(self) -> list[str]:
        """Return the gateway's messages since the last call. Raises GatewayError where it has ended."""
        assert self._process.stdout is not None
        self._heard += self._process.stdout.read() or b""
        *lines, self._heard = self._heard.split(b"\n")
        if not lines and self._process.poll() is not None:
            last = self._log.read_text("utf-8", "replace").strip().splitlines()[-1:]
            raise GatewayError(
                f"the page's server has ended{': '.join(['', *last])}: start another, such as by "
                "trunk live --attach NAMESPACE"
            )
        return [line.decode() for line in lines]

    def tell(self, **values: object) -> None:
        """Send these values to the gateway."""
        assert self._process.stdin is not None
        with suppress(OSError):  # it has ended
            self._process.stdin.write(json.dumps(values).encode() + b"\n")

    @property
    def pid(self) -> int:
        """The process's id."""
        return self._process.pid

    def close(self) -> None:
        """End the gateway."""
        with self._process as process:
            assert process.stdin is not None
            process.stdin.close()  # that ends it
            try:
                process.wait(_ENDS_S)
            except subprocess.TimeoutExpired:
                process.kill()


def url_of(listener: socket.socket) -> str:
    """Return the URL of the site that a socket serves."""
    host, port = listener.getsockname()[:2]
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens. Raises GatewayError where the address cannot be used."""
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
