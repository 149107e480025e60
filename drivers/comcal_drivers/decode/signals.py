# SPDX-License-Identifier: Apache-2.0
"""One signal of a message: its bits out of many payloads at once, its value as cantools has it.

Values are those of ``Message.decode(payload, decode_choices=False)`` to the last bit. cantools
computes in Python numbers: integers stay exact through an integer scale and offset however long
they are, everything else is ``raw * scale + offset`` in doubles, in this order. Numpy does the same
in doubles wherever all integers in between fit into their 53 bits; the few signals for which they
may not go through Python integers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from comcal.errors import ConfigError

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

Doubles = npt.NDArray[np.float64]
Payloads = npt.NDArray[np.uint8]

WORD = 64
"""Bits of the longest signal."""

EXACT = 2**53
"""Integers up to here are doubles."""


@dataclass(frozen=True)
class SignalLayout:
    """Where a signal stands in the payload, and what its bits mean.

    Parameters
    ----------
    name : str
    kind : {"u", "i", "f"}
        Unsigned integer, two's complement, IEEE 754 float of 16, 32 or 64 bits.
    is_big_endian : bool
        The most significant byte comes first.
    first : int
        Bit at which it begins: counted from the most significant bit of byte 0 when big-endian,
        from the least significant one when little-endian.
    size : int
        Bits.
    scale, offset : int or float
        Value = raw * scale + offset; integers where cantools computes in integers.
    unit : str
        As the file has it; empty where it has none.
    multiplexer : str or None
        Name of the signal that says whether this one is sent.
    selected_by : frozenset of int
        Values of *multiplexer* with which it is sent.
    """

    name: str
    kind: Literal["u", "i", "f"]
    is_big_endian: bool
    first: int
    size: int
    scale: float = 1
    offset: float = 0
    unit: str = ""
    multiplexer: str | None = None
    selected_by: frozenset[int] = frozenset()

    def values(self, payloads: Payloads) -> Doubles:
        """Return the signal's value in every payload.

        Parameters
        ----------
        payloads : array of uint8, shape (m, k)
            C-contiguous, k = 8 or 64, and the signal lies within.

        Returns
        -------
        array, shape (m,)
            In the unit of the file.
        """
        raw = self._raw(payloads)
        if self.scale == 1 and self.offset == 0:
            return raw.astype(np.float64)
        if self.kind != "f" and not self._is_exact_in_doubles():
            scaled = [number * self.scale + self.offset for number in raw.tolist()]
            return np.array([float(number) for number in scaled], np.float64)
        value = raw.astype(np.float64)
        value *= float(self.scale)
        value += float(self.offset)
        return value

    def _is_exact_in_doubles(self) -> bool:
        """Tell whether doubles give what Python integers would give."""
        if isinstance(self.scale, float):
            return True  # cantools turns the raw integer into a double first, too
        largest = (1 << self.size) * abs(self.scale)
        return largest + abs(self.offset) <= EXACT

    def _raw(self, payloads: Payloads) -> npt.NDArray[np.generic]:
        begin, bit = divmod(self.first, 8)
        if bit == 0 and self.size in (8, 16, 32, 64):
            order = ">" if self.is_big_endian else "<"
            field = payloads[:, begin : begin + self.size // 8]
            return field.view(f"{order}{self.kind}{self.size // 8}")[:, 0]
        word = self._bits(payloads)  # at the top of 64 bits, the rest below is not cleared
        spare = np.uint64(WORD - self.size)
        if self.kind == "i":
            return word.view(np.int64) >> np.int64(spare)
        number = word >> spare
        if self.kind == "f":
            return number.astype(f"u{self.size // 8}").view(f"f{self.size // 8}")
        return number

    def _bits(self, payloads: Payloads) -> npt.NDArray[np.uint64]:
        """Return the signal's bits moved to the top of words of 64 bits."""
        # Eight bytes around the signal; a ninth where a long one begins within a byte.
        begin = min(self.first // 8, payloads.shape[1] - 8)
        lead = self.first - 8 * begin
        end = lead + self.size
        field = np.ascontiguousarray(payloads[:, begin : begin + 8])
        if self.is_big_endian:
            word = field.view(">u8")[:, 0].astype(np.uint64) << np.uint64(lead)
            if end > WORD:
                ninth = payloads[:, begin + 8].astype(np.uint64)
                word |= ninth >> np.uint64(8 - lead)
            return word
        word = field.view("<u8")[:, 0].astype(np.uint64)
        if end > WORD:
            ninth = payloads[:, begin + 8].astype(np.uint64)
            word = (word >> np.uint64(lead)) | (ninth << np.uint64(WORD - lead))
            return word << np.uint64(WORD - self.size)
        return word << np.uint64(WORD - end)


def signal_layout(message: Message, signal: Signal) -> SignalLayout:
    """Compile a signal of cantools.

    Parameters
    ----------
    message : cantools Message
        To which it belongs.
    signal : cantools Signal

    Returns
    -------
    SignalLayout

    Raises
    ------
    ConfigError
        If it is longer than 64 bits, a float of another size than 16, 32 and 64 bits, or reaches
        beyond the message.
    """
    conversion = signal.conversion
    where = f"message {message.name}, signal {signal.name}"
    is_big_endian = signal.byte_order == "big_endian"
    # DBC counts bits within each byte from its least significant one, whatever the byte order.
    first = signal.start ^ 7 if is_big_endian else signal.start
    if signal.length > WORD or (conversion.is_float and signal.length not in (16, 32, 64)):
        raise ConfigError(
            f"a {'float' if conversion.is_float else 'number'} of this length is not decoded",
            where=where,
            measured=f"{signal.length} bits",
            limit="16, 32 or 64 bits" if conversion.is_float else f"{WORD} bits",
            next_step="describe it as several signals, or remove it from the file",
        )
    if first + signal.length > 8 * message.length:
        raise ConfigError(
            "the signal reaches beyond the end of its message",
            where=where,
            measured=f"bit {first + signal.length - 1}",
            limit=f"{8 * message.length} bits",
            next_step="mend its start bit, its length or its byte order in the file",
        )
    scale, offset = conversion.scale, conversion.offset
    if not conversion.is_float and _is_whole(scale) and _is_whole(offset):
        scale, offset = int(scale), int(offset)
    return SignalLayout(
        name=signal.name,
        kind="f" if conversion.is_float else "i" if signal.is_signed else "u",
        is_big_endian=is_big_endian,
        first=first,
        size=signal.length,
        scale=scale,
        offset=offset,
        unit=signal.unit or "",
        multiplexer=signal.multiplexer_signal,
        selected_by=frozenset(signal.multiplexer_ids or ()),
    )


def _is_whole(number: float) -> bool:
    return isinstance(number, int) or number.is_integer()
