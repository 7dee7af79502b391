"""Solids as signed distances: shapes with closest points, normals, mass properties, corners, and where they touch."""

from icjax.geometry._box import Box as Box
from icjax.geometry._contact import contact_manifold as contact_manifold
from icjax.geometry._contact import manifold_size as manifold_size
from icjax.geometry._ellipsoid import Ellipsoid as Ellipsoid
from icjax.geometry._heightfield import Heightfield as Heightfield
from icjax.geometry._manifold import Manifold as Manifold
from icjax.geometry._mesh import Mesh as Mesh
from icjax.geometry._plane import Plane as Plane
from icjax.geometry._polytope import Polytope as Polytope
from icjax.geometry._prism import Prism as Prism
from icjax.geometry._prism import wedge as wedge
from icjax.geometry._read_mesh import read_mesh as read_mesh
from icjax.geometry._read_mesh import triangle_mesh as triangle_mesh
from icjax.geometry._round import Capsule as Capsule
from icjax.geometry._round import Cylinder as Cylinder
from icjax.geometry._round import Sphere as Sphere
from icjax.geometry._shape import MassProperties as MassProperties
from icjax.geometry._shape import Placed as Placed
from icjax.geometry._shape import Probes as Probes
from icjax.geometry._shape import Shape as Shape
from icjax.geometry._union import Union as Union
