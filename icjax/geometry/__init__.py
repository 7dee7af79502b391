"""Surfaces as signed distances: differentiable shapes with closest points and normals."""

from icjax.geometry._ellipsoid import Ellipsoid as Ellipsoid
from icjax.geometry._plane import Plane as Plane
