# SPDX-License-Identifier: Apache-2.0
"""sympy as the type checker is to see it.

sympy's annotations are partial: an operator on two expressions is, for the checker, of no known
type. Expressions are therefore untyped, in this one place; what leaves the package is not.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import sympy

sp: Any = sympy

Expr: TypeAlias = Any
"""A ``sympy.Expr``."""
Symbol: TypeAlias = Any
"""A ``sympy.Symbol``."""
Matrix: TypeAlias = Any
"""A ``sympy.Matrix``."""
