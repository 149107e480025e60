# SPDX-License-Identifier: Apache-2.0
"""Worker processes for a study, each computing on one thread."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from typing import Any, TypeVar

from comcal.errors import UsageError

Result = TypeVar("Result")

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Small matrices get slower by threads, and sums may be ordered differently."""


def run_in_processes(
    function: Callable[..., Result], calls: Iterable[tuple[Any, ...]], workers: int
) -> Generator[Result, None, None]:
    """Call *function* with each tuple of arguments; yield results as they come.

    Workers are fresh interpreters, also when there is only one: results never depend on what the
    calling process has loaded or set. They end with the calling process, however that ends.

    Parameters
    ----------
    function : callable
        Importable, as are its arguments.
    calls : iterable of tuple
    workers : int

    Raises
    ------
    UsageError
        If a worker died, for instance for lack of memory.
    """
    with _one_thread_each():
        executor = ProcessPoolExecutor(workers, get_context("spawn"), _begin)
        try:
            for done in as_completed([executor.submit(function, *call) for call in calls]):
                yield done.result()
        except BrokenProcessPool as died:
            raise UsageError(
                "a worker process died",
                next_step="type the same command again, with fewer --workers if memory is short; "
                "what was finished is kept",
            ) from died
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _one_thread_each() -> Generator[None, None, None]:
    """Let processes that start now have one thread of linear algebra; numpy reads this once."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _begin() -> None:
    """Leave Ctrl-C to the parent, and end when it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
