# SPDX-License-Identifier: Apache-2.0
"""Columns of digits, as letters, to numbers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from comcal_drivers.frames.batches import to_microseconds

Text = npt.NDArray[np.uint8]
Doubles = npt.NDArray[np.float64]

EXACT = 2.0**53
"""Doubles hold every integer up to here."""

LARGEST_DIGIT, MICROSECONDS = 9, 6

_NO_PAIR, _NO_DIGIT = 0x100, 0x10


def _hexadecimal_digits() -> Text:
    values = np.full(256, _NO_DIGIT, np.uint8)
    for letter in b"0123456789ABCDEFabcdef":
        values[letter] = int(bytes((letter,)), 16)
    return values


def _hexadecimal_pairs() -> npt.NDArray[np.uint16]:
    digits = _hexadecimal_digits().astype(np.uint16)
    # Two letters read as one little-endian number: the first, worth 16 times more, is its low byte.
    values = digits[:, None] + 16 * digits[None, :]
    values[digits == _NO_DIGIT, :] = _NO_PAIR
    values[:, digits == _NO_DIGIT] = _NO_PAIR
    return values.ravel()


_DIGITS, _PAIRS = _hexadecimal_digits(), _hexadecimal_pairs()


def payload_bytes(letters: Text) -> tuple[Text, bool]:
    """Read pairs of hexadecimal digits.

    Parameters
    ----------
    letters : array of uint8, shape (m, 2 k)
        C-contiguous.

    Returns
    -------
    values : array of uint8, shape (m, k)
    good : bool
        All letters are digits.
    """
    pairs = np.take(_PAIRS, letters.view("<u2"))
    return pairs.astype(np.uint8), bool(pairs.max(initial=0) < _NO_PAIR)


def identifiers(letters: Text) -> tuple[npt.NDArray[np.uint32], bool]:
    """Read hexadecimal numbers.

    Parameters
    ----------
    letters : array of uint8, shape (m, k)
        At most eight digits.

    Returns
    -------
    values : array of uint32, shape (m,)
    good : bool
        All letters are digits.
    """
    values = np.zeros(letters.shape[0], np.uint32)
    seen = np.zeros(letters.shape[0], np.uint8)
    for column in letters.T:
        digit = np.take(_DIGITS, column)
        seen |= digit
        values <<= np.uint32(4)
        values |= digit
    return values, bool(seen.max(initial=0) < _NO_DIGIT)


def stamps(letters: Text, point: int) -> tuple[Doubles, bool]:
    """Read decimal numbers as Python's ``float`` does, to the last bit.

    Parameters
    ----------
    letters : array of uint8, shape (m, k)
        Digits with a point among them.
    point : int
        Place of the point.

    Returns
    -------
    values : array, shape (m,)
        Rounded to a microsecond where there are more digits.
    good : bool
        All letters but the point are digits.
    """
    digits = np.ascontiguousarray(letters) - np.uint8(ord("0"))  # wraps round below "0"
    digits[:, point] = 0
    if digits.max(initial=0) > LARGEST_DIGIT:
        return np.full(letters.shape[0], np.nan), False
    decimals = letters.shape[1] - point - 1
    exponents = np.arange(letters.shape[1] - 1, -1, -1)
    exponents[:point] -= 1  # the point is no digit
    # Sums of integers: whatever their order, exact as long as they are below 2^53.
    total = digits.astype(np.float64) @ np.power(10.0, exponents)
    if total.max(initial=0.0) < EXACT:
        t = total / 10.0**decimals  # both are exact, and division rounds once
    else:
        t = np.array([float(row.tobytes()) for row in letters])
    return (to_microseconds(t) if decimals > MICROSECONDS else t), True
