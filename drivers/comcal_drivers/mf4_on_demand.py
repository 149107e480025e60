# SPDX-License-Identifier: Apache-2.0
"""Let python-can load asammdf when an MF4 file is opened, not whenever python-can is imported.

``can.io.mf4`` imports asammdf, and with it pandas and sympy, where these are installed: seconds
before the first frame, also for those who have no MF4 file. With :func:`install` the module is
executed without asammdf at first, as if it were not installed, and completed when somebody makes an
``MF4Reader`` or ``MF4Writer``, be it comcal or other code in the same process.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from functools import wraps
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

MODULE = "can.io.mf4"
CLASSES = ("MF4Reader", "MF4Writer")
SLOW = "asammdf"


def install() -> None:
    """See to it; without effect where python-can or asammdf were imported already."""
    if MODULE in sys.modules or SLOW in sys.modules:
        return
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds what the other finders find, once, and changes how it is loaded."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != MODULE or self not in sys.meta_path:
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None and SLOW not in sys.modules:
            spec.loader = _Loader(spec.loader)
        return spec


class _Loader(Loader):
    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        absent = _Absent()
        sys.meta_path.insert(0, absent)
        try:
            self._loader.exec_module(module)
        finally:
            sys.meta_path.remove(absent)
        completion = _Completion(module, self._loader)
        for cls in completion.classes.values():
            completion.precede(cls)


class _Absent(MetaPathFinder):
    """Says, to this thread alone, that asammdf is not installed."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> None:
        if fullname == SLOW and threading.get_ident() == self._thread:
            raise ModuleNotFoundError(f"No module named {fullname!r}", name=fullname)


class _Completion:
    """Executes the module again, now with asammdf, when one of its classes is used first.

    Parameters
    ----------
    module : module
    loader : Loader
        That executes it without further ado.
    """

    def __init__(self, module: ModuleType, loader: Loader) -> None:
        self.classes: dict[str, Any] = {
            name: vars(module)[name] for name in CLASSES if name in vars(module)
        }
        self._module, self._loader = module, loader
        self._lock = threading.Lock()
        self._is_due = True

    def precede(self, cls: Any) -> None:
        """Let the making of instances of *cls* begin with the completion."""
        original = cls.__init__

        @wraps(original)
        def completed(instance: object, *args: object, **kwargs: object) -> None:
            self._complete()
            original(instance, *args, **kwargs)

        cls.__init__ = completed

    def _complete(self) -> None:
        with self._lock:
            if not self._is_due:
                return
            # The methods look names up in the module, which is filled anew in place; the classes
            # that others hold stay those of the module.
            self._loader.exec_module(self._module)
            for name, cls in self.classes.items():
                cls.__init__ = cls.__init__.__wrapped__
                setattr(self._module, name, cls)
            self._is_due = False
