"""Array types that every module shares."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
SmallIntArray: TypeAlias = NDArray[np.int32]
"""Numbers of names: tables have many rows."""
SmallestIntArray: TypeAlias = NDArray[np.int8]
"""Numbers of components of a row."""
