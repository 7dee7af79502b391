"""The two cones of the structured central path: the polygon of the paper, and the circle that it is inscribed in."""

import equinox as eqx
import jax.numpy as jnp

from icjax.contact._cone import tangents
from icjax.contact._cone_system import ConeSystem
from icjax.typing import Real


def _times(rows: Real, matrix: Real) -> Real:
    """Product with a small matrix, summed in the open: XLA joins it with what is around it, a call it does not."""
    return sum((rows[:, i, None] * matrix[None, i] for i in range(matrix.shape[0])), start=jnp.zeros((), rows.dtype))


class Polygon(ConeSystem):
    """The cone of 2m facets: z = (beta, lambda) and w = (nu, sigma) of each contact, `[N, 2m + 2]`."""

    facets: int = eqx.field(static=True)

    def _masks(self):
        slipping = self.local.active & (self.local.friction > 0)
        count = 2 * self.facets
        return jnp.concatenate([self.local.active[:, None], jnp.repeat(slipping[:, None], count + 1, axis=1)], axis=1)

    def _tangents(self):
        return jnp.asarray(tangents(self.facets), self.local.offset.dtype)

    def cone_live(self):
        return self._masks().reshape(-1)

    def cone_start(self, size):
        count = 2 * self.facets
        share = jnp.where(self.local.friction > 0, self.local.friction, 1.0)[:, None] / (count + 1)
        ones = jnp.ones((self.local.friction.shape[0], 1), share.dtype)
        z = jnp.concatenate([ones, jnp.repeat(share, count, axis=1), ones], axis=1)
        w = jnp.concatenate([jnp.repeat(ones, count + 1, axis=1), share], axis=1)
        return size * z, size * w

    def force(self, cone):
        beta = jnp.where(self._masks(), cone[0], 0.0)
        return jnp.concatenate([beta[:, :1], _times(beta[:, 1:-1], self._tangents())], axis=1)

    def cone_products(self, cone):
        z, w = cone
        return (z * w).reshape(-1)

    def cone_defects(self, cone, u):
        z, w = cone
        slips = _times(u[:, 1:], self._tangents().T) + z[:, -1:]
        within = self.local.friction * z[:, 0] - jnp.sum(z[:, 1:-1], axis=1)
        wanted = jnp.concatenate([u[:, :1], slips, within[:, None]], axis=1)
        return jnp.where(self._masks(), w - wanted, 0.0).reshape(-1)

    def cone_factor(self, cone):
        z, w = cone
        ratio = jnp.where(self._masks(), z / w, 0.0)
        tangent = self._tangents()
        total = _times(ratio[:, 1:-1], tangent)
        stiffness = jnp.sum(ratio[:, 1:-1], axis=1)
        slip = z[:, -1] / (w[:, -1] + z[:, -1] * stiffness)
        # d lambda = (...) + gain . du
        gain = slip[:, None] * jnp.concatenate([(self.local.friction * ratio[:, 0])[:, None], -total], axis=1)
        squares = (tangent[:, :, None] * tangent[:, None, :]).reshape(-1, 4)
        tangential = _times(ratio[:, 1:-1], squares).reshape(-1, 2, 2)
        normal = jnp.concatenate([ratio[:, :1], jnp.zeros_like(total)], axis=1)
        below = jnp.concatenate([jnp.zeros_like(tangential[:, :, :1]), tangential], axis=2)
        below = below + total[:, :, None] * gain[:, None, :]
        return jnp.concatenate([normal[:, None, :], below], axis=1), (ratio, total, slip, gain)

    def cone_answer(self, cone, kept, products, defects):
        z, w = cone
        ratio, total, slip, _ = kept
        masks = self._masks()
        shape = z.shape
        c = jnp.where(masks, products.reshape(shape), 0.0)
        r = jnp.where(masks, defects.reshape(shape), 0.0)
        alone = c / w - ratio * r
        within = self.local.friction * alone[:, 0] - jnp.sum(alone[:, 1:-1], axis=1) + r[:, -1]
        multiplier = slip * (c[:, -1] / z[:, -1] - within)
        multiplier = jnp.where(masks[:, -1], multiplier, 0.0)
        tangential = _times(alone[:, 1:-1], self._tangents()) - total * multiplier[:, None]
        return jnp.concatenate([alone[:, :1], tangential], axis=1), (alone, multiplier, r)

    def cone_change(self, cone, kept, answer, du):
        ratio, _, _, gain = kept
        alone, multiplier, r = answer
        masks = self._masks()
        multiplier = multiplier + jnp.where(masks[:, -1], jnp.sum(gain * du, axis=1), 0.0)
        w = jnp.concatenate([du[:, :1], _times(du[:, 1:], self._tangents().T) + multiplier[:, None]], axis=1)
        z = alone[:, :-1] - ratio[:, :-1] * w
        within = self.local.friction * z[:, 0] - jnp.sum(z[:, 1:], axis=1)
        w = jnp.concatenate([w, within[:, None]], axis=1) + r
        z = jnp.concatenate([z, multiplier[:, None]], axis=1)
        return jnp.where(masks, z, 0.0), jnp.where(masks, w, 0.0)

    def cone_reach(self, cone, change):
        (z, w), (dz, dw) = cone, change
        return jnp.max(jnp.maximum(-dz / z, -dw / w), initial=0.0)


class Circle(ConeSystem):
    """Coulomb's cone: ``f_n u_n = kappa``, ``u_t + rate f_t = 0`` and ``rate (mu^2 f_n^2 - |f_t|^2) / 2 = kappa``.

    Variables of each contact: f_n and u_n, f_t `[N, 2]`, the rate (slip over friction force). For kappa -> 0 the
    friction force lies within the circle of radius mu f_n, on it and against the slip where there is any.
    """

    def _slipping(self):
        return self.local.active & (self.local.friction > 0)

    def cone_live(self):
        return jnp.concatenate([self.local.active, self._slipping()])

    def cone_start(self, size):
        ones = jnp.ones_like(self.local.friction) * size
        rate = 1.0 / jnp.where(self._slipping(), self.local.friction, 1.0)
        return ones, ones, jnp.zeros((ones.shape[0], 2), ones.dtype), rate

    def force(self, cone):
        normal, _, tangential, _ = cone
        normal = jnp.where(self.local.active, normal, 0.0)
        tangential = jnp.where(self._slipping()[:, None], tangential, 0.0)
        return jnp.concatenate([normal[:, None], tangential], axis=1)

    def _inside(self, cone):
        """Half the difference of the squares of radius and friction force."""
        normal, _, tangential, _ = cone
        return ((self.local.friction * normal) ** 2 - jnp.sum(tangential**2, axis=1)) / 2

    def cone_products(self, cone):
        normal, clearance, _, rate = cone
        return jnp.concatenate([normal * clearance, rate * self._inside(cone)])

    def cone_defects(self, cone, u):
        _, clearance, tangential, rate = cone
        normal = jnp.where(self.local.active, clearance - u[:, 0], 0.0)
        slip = jnp.where(self._slipping()[:, None], u[:, 1:] + rate[:, None] * tangential, 0.0)
        return jnp.concatenate([normal, slip.reshape(-1)])

    def cone_factor(self, cone):
        normal, clearance, tangential, rate = cone
        ratio = jnp.where(self.local.active, normal / clearance, 0.0)
        inside = jnp.where(self._slipping(), self._inside(cone), 1.0)
        reduced = tangential / (inside + jnp.sum(tangential**2, axis=1))[:, None]
        live = self._slipping()[:, None]
        soft = jnp.eye(2, dtype=rate.dtype)[None] - tangential[:, :, None] * reduced[:, None, :]
        soft = jnp.where(live[:, :, None], soft / rate[:, None, None], 0.0)
        # df_t = (...) - soft du_t + grip df_n
        grip = jnp.where(live, reduced * (self.local.friction**2 * normal)[:, None], 0.0)
        above = jnp.concatenate([ratio[:, None], jnp.zeros_like(grip)], axis=1)
        below = jnp.concatenate([(grip * ratio[:, None])[:, :, None], soft], axis=2)
        return jnp.concatenate([above[:, None, :], below], axis=1), (ratio, inside, soft, grip)

    def cone_answer(self, cone, kept, products, defects):
        normal, clearance, tangential, rate = cone
        ratio, inside, soft, grip = kept
        count = normal.shape[0]
        c_n = jnp.where(self.local.active, products[:count], 0.0)
        r_n = jnp.where(self.local.active, defects[:count], 0.0)
        c_t = jnp.where(self._slipping(), products[count:], 0.0)
        r_t = jnp.where(self._slipping()[:, None], defects[count:].reshape(count, 2), 0.0)
        alone = c_n / clearance - ratio * r_n
        pushed = r_t - tangential * (c_t / inside)[:, None]
        slid = jnp.sum(soft * pushed[:, None, :], axis=2) + grip * alone[:, None]
        return jnp.concatenate([alone[:, None], slid], axis=1), (alone, slid, r_n, c_t)

    def cone_change(self, cone, kept, answer, du):
        normal, _, tangential, rate = cone
        ratio, inside, soft, grip = kept
        alone, slid, r_n, c_t = answer
        change_n = alone - ratio * du[:, 0]
        change_t = slid - jnp.sum(soft * du[:, None, 1:], axis=2) - grip * (ratio * du[:, 0])[:, None]
        grown = self.local.friction**2 * normal * change_n - jnp.sum(tangential * change_t, axis=1)
        change_rate = jnp.where(self._slipping(), (c_t - rate * grown) / inside, 0.0)
        return change_n, jnp.where(self.local.active, du[:, 0] + r_n, 0.0), change_t, change_rate

    def cone_reach(self, cone, change):
        normal, clearance, tangential, rate = cone
        d_normal, d_clearance, d_tangential, d_rate = change
        simple = jnp.maximum(jnp.maximum(-d_normal / normal, -d_clearance / clearance), -d_rate / rate)
        # The larger root of c / t^2 + 2 b / t + a, that is of (R + t dR)^2 = |f + t df|^2.
        a = (self.local.friction * d_normal) ** 2 - jnp.sum(d_tangential**2, axis=1)
        b = self.local.friction**2 * normal * d_normal - jnp.sum(tangential * d_tangential, axis=1)
        c = jnp.where(self._slipping(), 2 * self._inside(cone), 1.0)
        met = (b * b >= a * c) & self._slipping()
        root = (jnp.sqrt(jnp.where(met, b * b - a * c, 0.0)) - b) / c
        return jnp.max(jnp.maximum(simple, jnp.where(met, root, 0.0)), initial=0.0)
