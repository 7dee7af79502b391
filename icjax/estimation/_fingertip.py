"""Path of a fingertip from the markers of its own segment, without the filter of the joint angles."""

import equinox as eqx
import jax
import numpy as np

from icjax.model import Model, forward_kinematics, site_positions
from icjax.recording import Recording
from icjax.typing import Float


def fingertip_path(
    recording: Recording, body: int, place: Float[np.ndarray, "3"], start: float, stop: float
) -> tuple[Float[np.ndarray, " frame"], Float[np.ndarray, "frame 3"]]:
    """World path of a point of a body: its pose from the filtered `q`, its displacement from the raw markers.

    p(t) = X(q(t)) place + mean over the body's markers of (marker - site(q(t))), less the same mean at rest. The
    joint angles are low-pass filtered, which smears a sudden movement; the markers are not. What the filter does to
    the segment's rotation remains, times the distance from its markers to the point.

    **Arguments**: `body` index; `place` m, body frame; `start`, `stop` s: the first 50 ms are the rest.

    **Returns** times (s) and positions (m); NaN where no marker of the body is seen or the pose is unknown.

    **Errors**: `ValueError` where no marker that bears the name of one of the body's sites is seen at rest.
    """
    time = np.asarray(recording.time)
    chosen = (time >= start) & (time <= stop)
    model = recording.model
    found = _sites_of(recording, body)
    if not found:
        raise ValueError(f"{recording.name}: no marker is on the body {model.body_names[body]!r}")
    q = np.asarray(recording.q)[chosen]
    points, sites = _places(model, q, body, place)
    columns, numbers = zip(*found, strict=True)
    off = np.asarray(recording.markers)[chosen][:, list(columns)] - np.asarray(sites)[:, list(numbers)]
    rest = time[chosen] <= start + 0.05
    seen = np.asarray(np.isfinite(off).all(axis=2))
    seen &= seen[rest].any(axis=0)
    if not seen.any():
        raise ValueError(f"{recording.name}: no marker of {model.body_names[body]!r} is seen before the perturbation")
    count = np.maximum(np.sum(rest[:, None] & seen, axis=0), 1)
    own = np.sum(np.where((rest[:, None] & seen)[:, :, None], off, 0.0), axis=0) / count[:, None]
    known = seen.any(axis=1) & np.asarray(recording.valid)[chosen]
    shift = np.sum(np.where(seen[:, :, None], off - own, 0.0), axis=1) / np.maximum(seen.sum(axis=1), 1)[:, None]
    shift[~known] = np.nan
    return time[chosen], np.asarray(points) + shift


def _sites_of(recording: Recording, body: int) -> list[tuple[int, int]]:
    """(marker, site) of the body's markers; a marker has the name of its site, as capture writes it."""
    model = recording.model
    return [
        (column, model.site(name))
        for column, name in enumerate(recording.marker_names)
        if name in model.site_names and model.site_bodies[model.site(name)] == body
    ]


@eqx.filter_jit
def _places(model: Model, q, body: int, place):
    def one(q):
        return forward_kinematics(model, q)[body].apply(place), site_positions(model, q)

    return jax.vmap(one)(q)
