"""Central paths of the contact problem, eliminated contact by contact: 3 N + R equations, whatever the cone."""

from abc import abstractmethod
from typing import Any, NamedTuple

import jax.numpy as jnp

from icjax.contact._local import LocalProblem
from icjax.lcp import System, factored, solve_factored, times
from icjax.typing import Float, Real


class _Factor(NamedTuple):
    lu: Real
    permutation: Real
    slope: Real  # B, how the forces of each contact answer to its displacement: df = p - B du, [N, 3, 3]
    limit_slope: Real
    cone: Any  # what the cone keeps


class _Point(NamedTuple):
    cone: Any
    limit: Real  # force and clearance of the limits
    room: Real


class ConeSystem(System):
    """One step's contact problem in contact frames, its W definite.

    Each contact answers a change of its displacement with ``df = p - B du``; with that Newton's equations are
    ``(I + B W) df = p``. Limits are contacts with a normal only.
    """

    local: LocalProblem

    @abstractmethod
    def cone_live(self) -> Real:
        """Which products of the contacts count, flat."""

    @abstractmethod
    def cone_start(self, size) -> Any:
        """Variables of the contacts."""

    @abstractmethod
    def force(self, cone: Any) -> Float[Real, "contact 3"]:
        """In the contact frames, normal first; zero in masked slots."""

    @abstractmethod
    def cone_products(self, cone: Any) -> Real:
        """Flat."""

    @abstractmethod
    def cone_defects(self, cone: Any, u: Float[Real, "contact 3"]) -> Real:
        """Flat."""

    @abstractmethod
    def cone_factor(self, cone: Any) -> tuple[Real, Any]:
        """B `[N, 3, 3]`, and what `cone_answer` needs."""

    @abstractmethod
    def cone_answer(self, cone: Any, kept: Any, products: Real, defects: Real) -> tuple[Real, Any]:
        """p `[N, 3]`, and what `cone_change` needs."""

    @abstractmethod
    def cone_change(self, cone: Any, kept: Any, answer: Any, du: Float[Real, "contact 3"]) -> Any:
        """Changes of the variables."""

    @abstractmethod
    def cone_reach(self, cone: Any, change: Any) -> Real:
        """Inverse of the step to the boundary."""

    def live(self) -> Real:
        return jnp.concatenate([self.cone_live(), self.local.limit_active])

    def start(self, size) -> _Point:
        ones = jnp.full(self.local.limit_active.shape, size, self.local.offset.dtype)
        return _Point(self.cone_start(size), ones, ones)

    def forces(self, point: _Point) -> Float[Real, " component"]:
        """All forces: three of each contact in its frame, then one of each limit."""
        limit = jnp.where(self.local.limit_active, point.limit, 0.0)
        return jnp.concatenate([self.force(point.cone).reshape(-1), limit])

    def products(self, point: _Point) -> Real:
        return jnp.concatenate([self.cone_products(point.cone), point.limit * point.room])

    def defects(self, point: _Point) -> Real:
        u, room = self.local.split(self.local.displacement(self.forces(point)))
        limits = jnp.where(self.local.limit_active, point.room - room, 0.0)
        return jnp.concatenate([self.cone_defects(point.cone, u), limits])

    def factor(self, point: _Point) -> _Factor:
        contacts = self.local.contacts
        slope, kept = self.cone_factor(point.cone)
        limit_slope = jnp.where(self.local.limit_active, point.limit / point.room, 0.0)
        size = self.local.offset.shape[0]
        top = self.local.coupling[: 3 * contacts].reshape(contacts, 3, size)
        # A sum of three products: XLA makes one loop of it, where a batch of small matrix products would be slow.
        product = sum(slope[:, :, i, None] * top[:, None, i, :] for i in range(3))
        matrix = jnp.concatenate(
            [jnp.reshape(product, (3 * contacts, size)), limit_slope[:, None] * self.local.coupling[3 * contacts :]]
        )
        lu, permutation = factored(matrix + jnp.eye(size, dtype=matrix.dtype))
        return _Factor(lu, permutation, slope, limit_slope, kept)

    def direction(self, point: _Point, factor: _Factor, products: Real, defects: Real) -> _Point:
        limits = self.local.limit_active.shape[0]
        cone_products, limit_products = jnp.split(products, [products.shape[0] - limits])
        cone_defects, limit_defects = jnp.split(defects, [defects.shape[0] - limits])
        p, answer = self.cone_answer(point.cone, factor.cone, cone_products, cone_defects)
        limit_p = (limit_products - point.limit * limit_defects) / point.room
        limit_p = jnp.where(self.local.limit_active, limit_p, 0.0)
        rhs = jnp.concatenate([p.reshape(-1), limit_p])
        df = solve_factored(factor.lu, factor.permutation, rhs)
        du, limit_du = self.local.split(times(self.local.coupling, df))
        limit = limit_p - factor.limit_slope * limit_du
        room = jnp.where(self.local.limit_active, limit_du + limit_defects, 0.0)
        return _Point(self.cone_change(point.cone, factor.cone, answer, du), limit, room)

    def reach(self, point: _Point, direction: _Point):
        limits = jnp.maximum(-direction.limit / point.limit, -direction.room / point.room)
        return jnp.maximum(self.cone_reach(point.cone, direction.cone), jnp.max(limits, initial=0.0))
