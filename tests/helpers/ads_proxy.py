"""Somebody between a recorder and its PLC on loopback, who hands on what he likes."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

ADS_PORT = 48898
TCP_HEADER = 6  # two reserved bytes, length
AMS_HEADER = 32  # addresses, command, flags, length, error, number of the request
DATA = TCP_HEADER + AMS_HEADER + 8  # of an answer to a read, behind its result and length

# Answers of the PLC so far -> the bytes that the recorder gets in place of the last of them.
Meddle = Callable[[Sequence[bytes]], bytes]


class AdsProxy:
    """Hands a recorder's requests on to a PLC, and its answers back as `meddle` makes them.

    address, plc : of this machine, of the proxy and of the PLC's server.
    """

    def __init__(self, address: str, plc: str, meddle: Meddle) -> None:
        self._plc, self._meddle = plc, meddle
        self._server = socket.create_server((address, ADS_PORT))
        self._server.settimeout(0.1)
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._accept)]

    def __enter__(self) -> Self:
        self._threads[0].start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._server.close()

    def _accept(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._server.accept()
            except TimeoutError:
                continue
            serve = threading.Thread(target=self._serve, args=(client,))
            self._threads.append(serve)
            serve.start()

    def _serve(self, client: socket.socket) -> None:
        answers: list[bytes] = []
        with client, socket.create_connection((self._plc, ADS_PORT)) as plc:
            client.settimeout(0.1)
            plc.settimeout(1.0)
            while not self._stop.is_set():
                try:
                    plc.sendall(client.recv(65536, socket.MSG_PEEK) and _frame(client))
                    answers.append(_frame(plc))
                    client.sendall(self._meddle(answers))
                except TimeoutError:
                    continue
                except OSError:
                    return


def _frame(peer: socket.socket) -> bytes:
    """One frame of ADS. Raises OSError at the end of the connection."""
    head = _received(peer, TCP_HEADER)
    return head + _received(peer, struct.unpack_from("<I", head, 2)[0])


def _received(peer: socket.socket, size: int) -> bytes:
    out = b""
    while len(out) < size:
        part = peer.recv(size - len(out))
        if not part:
            raise ConnectionResetError
        out += part
    return out
