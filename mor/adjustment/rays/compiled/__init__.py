"""Compiled kernels. A kernel called from another kernel is decorated likewise.

While developing: numba recompiles a kernel when its own file changes, not when that of a kernel it calls does.
After such a change touch the files of the callers, or remove ``compiled/__pycache__``.
"""

from __future__ import annotations
