"""Array aliases shared by every layer.

Records accept JAX arrays (inside transformations) and NumPy arrays (as read from files); shapes are written
with jaxtyping, for example ``Float[Real, "time 3"]``. Units are SI throughout: m, kg, s, N, Nm, rad, rad/Nm.
"""

from typing import TypeAlias

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

Real: TypeAlias = jax.Array | np.ndarray
"""Anything that holds numbers: a JAX array (traced or not) or a NumPy array."""

Scalar: TypeAlias = Float[Real, ""]
Vector3: TypeAlias = Float[Real, "3"]
Matrix3: TypeAlias = Float[Real, "3 3"]
Vector6: TypeAlias = Float[Real, "6"]
Matrix6: TypeAlias = Float[Real, "6 6"]
Quaternion: TypeAlias = Float[Real, "4"]
"""Unit quaternion in the order (w, x, y, z)."""

__all__ = [
    "Bool",
    "Float",
    "Int",
    "Matrix3",
    "Matrix6",
    "Quaternion",
    "Real",
    "Scalar",
    "Vector3",
    "Vector6",
]
