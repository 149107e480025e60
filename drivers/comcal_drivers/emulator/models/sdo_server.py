# SPDX-License-Identifier: Apache-2.0
"""The objects of a CANopen node, and the server through which a host reads and writes them.

Source: CiA 301, section 7.2.4: expedited transfers both ways, segmented ones for longer objects.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

NO_OBJECT, NO_SUBINDEX = 0x06020000, 0x06090011
READ_ONLY, WRONG_LENGTH = 0x06010002, 0x06070010
NO_COMMAND, NOT_TOGGLED = 0x05040001, 0x05030000
_EXPEDITED = 4
_SEGMENT = 7

Key = tuple[int, int]
"""Index and subindex."""


@dataclass
class SdoServer:
    """Objects as bytes, little-endian.

    Parameters
    ----------
    objects : dict from (index, subindex) to bytes
        Their length stays what it is.
    writable : set of (index, subindex)
    """

    objects: dict[Key, bytes]
    writable: set[Key] = field(default_factory=set[Key])
    _rest: bytes = b""
    _toggle: int = 0

    def integer(self, index: int, subindex: int = 0, *, signed: bool = False) -> int:
        """Return an object as a number."""
        return int.from_bytes(self.objects[index, subindex], "little", signed=signed)

    def put(self, index: int, value: int, subindex: int = 0) -> None:
        """Set an object that is a number; it keeps its length."""
        size = len(self.objects[index, subindex])
        self.objects[index, subindex] = (value & ((1 << 8 * size) - 1)).to_bytes(size, "little")

    def answer(self, request: bytes) -> tuple[bytes, Key | None]:
        """Obey one request of eight bytes.

        Returns
        -------
        answer : bytes
            Eight bytes.
        written : (index, subindex) or None
            The object that was written.
        """
        request = request.ljust(8, b"\0")
        index, subindex = struct.unpack_from("<HB", request, 1)
        command = request[0] >> 5
        if command == 2:
            return self._upload((index, subindex)), None
        if command == 3:
            return self._segment(request[0] >> 4 & 1), None
        if command == 1:
            return self._download((index, subindex), request)
        return _abort((index, subindex), NO_COMMAND), None

    def _upload(self, key: Key) -> bytes:
        data = self.objects.get(key)
        if data is None:
            return _abort(key, self._missing(key))
        if len(data) <= _EXPEDITED:
            head = 0x43 | (_EXPEDITED - len(data)) << 2
            return struct.pack("<BHB", head, *key) + data.ljust(_EXPEDITED, b"\0")
        self._rest, self._toggle = data, 0
        return struct.pack("<BHBI", 0x41, *key, len(data))

    def _segment(self, toggle: int) -> bytes:
        if toggle != self._toggle or not self._rest:
            return _abort((0, 0), NOT_TOGGLED)
        piece, self._rest = self._rest[:_SEGMENT], self._rest[_SEGMENT:]
        head = toggle << 4 | (_SEGMENT - len(piece)) << 1 | (not self._rest)
        self._toggle ^= 1
        return bytes([head]) + piece.ljust(_SEGMENT, b"\0")

    def _download(self, key: Key, request: bytes) -> tuple[bytes, Key | None]:
        old = self.objects.get(key)
        if old is None:
            return _abort(key, self._missing(key)), None
        if key not in self.writable:
            return _abort(key, READ_ONLY), None
        head = request[0]
        size = _EXPEDITED - (head >> 2 & 3) if head & 1 else len(old)
        if not head & 2 or size != len(old):
            return _abort(key, WRONG_LENGTH), None
        self.objects[key] = request[4 : 4 + size]
        return struct.pack("<BHBI", 0x60, *key, 0), key

    def _missing(self, key: Key) -> int:
        return NO_SUBINDEX if any(index == key[0] for index, _ in self.objects) else NO_OBJECT


def _abort(key: Key, code: int) -> bytes:
    return struct.pack("<BHBI", 0x80, *key, code)
