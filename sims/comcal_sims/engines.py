# SPDX-License-Identifier: Apache-2.0
"""Importing physics engines, which are optional and talkative."""

from __future__ import annotations

import ctypes
import importlib
import os
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from types import ModuleType

from comcal.errors import MissingExtraError


def import_engine(module: str, extra: str) -> tuple[ModuleType, str]:
    """Import an engine without what it prints, and return it with its version.

    Parameters
    ----------
    module : str
        Name of the module and of its distribution.
    extra : str
        Extra of comcal that installs it, for the message.

    Raises
    ------
    MissingExtraError
        If the engine is not installed.
    """
    try:
        with silenced():
            engine = importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"the simulator needs {module}, which is not installed",
            measured=str(error),
            next_step=f"pip install 'comcal[{extra}]', or use another engine",
        ) from error
    return engine, version(module)


@contextmanager
def silenced() -> Generator[None, None, None]:
    """Discard what C code writes to the standard streams meanwhile; restored even on error.

    Replacing ``sys.stdout`` would not reach C code, and its buffer has to be flushed on both sides:
    otherwise earlier output would be lost and the unwanted lines would appear at exit.
    """
    with ExitStack() as stack:
        for stream, descriptor in ((sys.stdout, 1), (sys.stderr, 2)):
            if not stream.closed:
                stream.flush()
            stack.enter_context(_discarded(descriptor))
        yield


@contextmanager
def _discarded(descriptor: int) -> Generator[None, None, None]:
    _flush_c()
    try:
        saved = os.dup(descriptor)
    except OSError:  # the stream is closed: nothing can be written to it anyway
        yield
        return
    try:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, descriptor)
        os.close(null)
        yield
    finally:
        _flush_c()
        os.dup2(saved, descriptor)
        os.close(saved)


def _flush_c() -> None:
    """Flush the buffers of C's own streams, which Python does not share."""
    if os.name == "posix":
        ctypes.CDLL(None).fflush(None)
