"""Dynamic equilibrium in the deviation from the contact-free movement: a model of the first 100 ms of a contact."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import solve_triangular

from icjax.fit._parameters import Values
from icjax.fit._response import response
from icjax.typing import Float, Int, Real


class Common(eqx.Module):
    r"""What several rows of white noise have in common besides: r = n + A p, n and p of unit variance.

    With A = U S V^T the rows U^T r have the variance 1 + s^2, so that I - U D U^T with D = 1 - (1 + s^2)^(-1/2) whitens
    r. p is integrated out: what is known of everything else is the same as if p were fitted with it.

    **Fields**: `basis` U [row, mode]; `share` D [mode], in [0, 1).
    """

    basis: Float[Real, "row mode"]
    share: Float[Real, " mode"]

    @staticmethod
    def of(A: Float[np.ndarray, "row mode"]) -> "Common":
        """**Arguments**: A, effect of p on the rows."""
        U, s, _ = np.linalg.svd(A, full_matrices=False)
        return Common(U, 1.0 - 1.0 / np.sqrt(1.0 + s**2))

    def whitened(self, rows: Float[Real, "row *column"]) -> Float[Real, "row *column"]:
        """(I - U D U^T) r, of one r or of columns."""
        U = jnp.asarray(self.basis)
        return rows - (U * jnp.asarray(self.share)[None]) @ (U.T @ rows)

    def plain(self, rows: Float[np.ndarray, "row *column"]) -> Float[np.ndarray, "row *column"]:
        """r of whitened rows."""
        U, D = np.asarray(self.basis), np.asarray(self.share)
        return rows + (U * (D / (1.0 - D))) @ (U.T @ rows)

    def expected(self, rows: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
        """A p, its mean given r: U S^2 / (1 + S^2) U^T r."""
        U, D = np.asarray(self.basis), np.asarray(self.share)
        return U @ ((1.0 - (1.0 - D) ** 2) * (U.T @ rows))


class DynamicEquilibrium(eqx.Module):
    """Angles after contact against those of repetitions without it.

    With e = q - q_ref the deviation from the movement that would have gone on,

        M e'' + (N + B) e' + (G + K) e = J^T f - t,    K = C^-1,    B = T K (joint by joint),

    t the torque that it takes to go along with the rest of the body where the contact pushes that aside (`pushed`).
    M, N and G are the derivatives of the inverse dynamics by acceleration, velocity and angle at the measured movement
    (so that inertia of the planned movement, Coriolis and gravity terms at q_ref and q are accounted for to first
    order),
    each a sum over segments of a mass factor times the segment's own. e is integrated by the implicit midpoint rule at
    the rate of the recording from rest before the contact. What is compared,

        y = q - mean of the repetitions - e = (deviation of both from what was intended) + noise,

    has the covariance that the repetitions themselves show, and is whitened with it; the samples before contact hold
    the repetitions against the trial.

    **Fields** (events padded to one length; all of one session)

    - `step` s; `torque` Nm, `torque_rate`, `by_offset` (its derivative by offsets) of every frame;
      `inertia` three arrays [event, frame, segment, dof, dof]; `armature` [dof].
    - `frames` [event, sample]: frames that are compared; `difference` rad [event, sample, dof]: trial less repetitions;
      `whitening` [event, n, n]: inverse of the Cholesky factor of its covariance, zero rows where nothing is compared.
    - `common`: the `Common` part of contacts without repetitions; None without any.
    - `carried` Nm [event, frame, segment, dof]: t of a segment; None where the rest of the body does not move.
      `carried_doubt` [event, frame, segment, dof, mode]: what t is not known by; None where it is known.

    - `period` [event]: the row of "compliance" that holds in an event; None: one holds in all.

    **Uses** "compliance" (diagonal `[dof]` or full `[dof, dof]`; with periods one of them each), "damping time"
    `[dof]`, "inertia" `[segment]`, "offsets" `[offset]` in units of its prior (`offset_factor` its Cholesky factor),
    "sensor gain" and "sensor delay", and where there is a `carried_doubt` "carried" `[mode]` in units of it.

    Source: the deviation form of Kry and Pai 2006, section 4.3; the whitening is ours.
    """

    name: str = eqx.field(static=True)
    step: float = eqx.field(static=True)
    torque: Float[Real, "event frame dof"]
    torque_rate: Float[Real, "event frame dof"]
    by_offset: Float[Real, "event frame dof offset"]
    inertia: tuple[Any, Any, Any]
    armature: Float[Real, " dof"]
    offset_factor: Float[Real, "offset offset"]
    frames: Int[Real, "event sample"]
    difference: Float[Real, "event sample dof"]
    whitening: Float[Real, "event n n"]
    common: Common | None = None
    carried: Float[Real, "event frame segment dof"] | None = None
    carried_doubt: Float[Real, "event frame segment dof mode"] | None = None
    period: Int[Real, " event"] | None = None

    @property
    def uses(self) -> tuple[str, ...]:
        """Names of the parameters that it looks at."""
        always = ("compliance", "damping time", "inertia", "offsets", "sensor gain", "sensor delay")
        return always if self.carried_doubt is None else (*always, "carried")

    def deviation(self, values: Values) -> Float[Real, "event frame dof"]:
        """e of every event and frame, rad."""
        offset = jnp.asarray(self.offset_factor) @ values["offsets"]
        torque = values["sensor gain"] * (
            jnp.asarray(self.torque)
            + jnp.einsum("etij,j->eti", jnp.asarray(self.by_offset), offset)
            - values["sensor delay"] * jnp.asarray(self.torque_rate)
        )
        if self.carried is not None:
            torque = torque - jnp.einsum("etsi,s->eti", jnp.asarray(self.carried), values["inertia"])
        if self.carried_doubt is not None:
            doubt = jnp.asarray(self.carried_doubt) @ values["carried"]
            torque = torque - jnp.einsum("etsi,s->eti", doubt, values["inertia"])
        inertia = tuple(jnp.asarray(part) for part in self.inertia)
        C = jnp.asarray(values["compliance"])
        C = jnp.broadcast_to(C, (len(torque), *C.shape)) if self.period is None else C[jnp.asarray(self.period)]
        return jax.vmap(
            lambda parts, tau, C: response(parts, tau, values | {"compliance": C}, self.armature, self.step)
        )(inertia, torque, C)

    def residual(self, values: Values) -> Float[Real, " row"]:
        """Whitened `[event * sample * dof]`."""
        deviation = self.deviation(values)
        left = jnp.asarray(self.difference) - jax.vmap(lambda e, at: e[at])(deviation, jnp.asarray(self.frames))
        flat = left.reshape(left.shape[0], -1)
        white = jnp.ravel(jnp.einsum("eij,ej->ei", jnp.asarray(self.whitening), flat))
        return white if self.common is None else self.common.whitened(white)


def whitener(covariance: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Inverse of the Cholesky factor of a covariance [n, n] on the rows that are used, zero elsewhere."""
    rows = np.flatnonzero(used)
    result = np.zeros_like(covariance)
    factor = np.linalg.cholesky(covariance[np.ix_(rows, rows)])
    result[np.ix_(rows, rows)] = solve_triangular(factor, np.eye(len(rows)), lower=True)
    return result
