"""Closed surfaces of triangles: what is wrong with one, and how much of it can be put right."""

from collections.abc import Iterator

import numpy as np

from icjax.typing import Float, Int

_Faces = Int[np.ndarray, "triangle 3"]


def faults(vertices: Float[np.ndarray, "vertex 3"], faces: _Faces) -> str | None:
    """Why triangles bound no solid; None where they do."""
    start, stop = _edges(faces)
    low, high = np.minimum(start, stop), np.maximum(start, stop)
    _, place, times = np.unique(low * len(vertices) + high, return_inverse=True, return_counts=True)
    if (times == 1).any():
        return f"is open: {int((times == 1).sum())} edges belong to one triangle only"
    if (times > 2).any():
        return f"bounds no solid: {int((times > 2).sum())} edges belong to more than two triangles"
    upward = np.zeros(len(times), int)
    np.add.at(upward, place, np.where(start < stop, 1, -1))
    if upward.any():
        return f"has triangles that face the wrong way, along {int((upward != 0).sum())} edges"
    if volume(vertices, faces) <= 0:
        return f"is inside out: its volume is {volume(vertices, faces):.3g} m3"
    return None


def repaired(
    vertices: Float[np.ndarray, "vertex 3"], faces: _Faces
) -> tuple[Float[np.ndarray, "more 3"], Int[np.ndarray, "others 3"]]:
    """With triangles that face one way, holes filled from their middles, and turned right side out."""
    faces = _one_way(faces)
    start, stop = _edges(faces)
    there = set(zip(start.tolist(), stop.tolist(), strict=True))
    after: dict[int, list[int]] = {}
    for a, b in sorted(there):
        if (b, a) not in there:
            after.setdefault(b, []).append(a)  # round the hole, the other way
    rows, middles = [faces], [vertices]
    count = len(vertices)
    for ring in _rings(after):
        middles.append(vertices[ring].mean(axis=0, keepdims=True))
        rows.append(np.stack([ring, np.roll(ring, -1), np.full(len(ring), count)], axis=1))
        count += 1
    vertices, faces = np.concatenate(middles), np.concatenate(rows)
    return vertices, faces[:, ::-1] if volume(vertices, faces) < 0 else faces


def _rings(after: dict[int, list[int]]) -> Iterator[np.ndarray]:
    """Rings of the way from each vertex to others, none of which passes a vertex twice; what is left is no ring."""
    while after:
        way = [next(iter(after))]
        while way[-1] in after:
            following = after[way[-1]]
            here = following.pop()
            if not following:
                del after[way[-1]]
            if here in way:
                start = way.index(here)
                yield np.array(way[start:])
                del way[start + 1 :]
            else:
                way.append(here)


def volume(vertices: Float[np.ndarray, "vertex 3"], faces: _Faces) -> float:
    """That triangles enclose, negative if they face inwards, m3."""
    a, b, c = np.moveaxis(vertices[faces] - vertices.mean(axis=0), 1, 0)
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def _edges(faces: _Faces) -> tuple[np.ndarray, np.ndarray]:
    return faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)


def _one_way(faces: _Faces) -> _Faces:
    """Of every connected part, the way that most of its triangles face."""
    beside: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for number, (a, b, c) in enumerate(faces.tolist()):
        for start, stop in ((a, b), (b, c), (c, a)):
            beside.setdefault((min(start, stop), max(start, stop)), []).append((number, start < stop))
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in faces]
    for pair in beside.values():
        if len(pair) == 2:
            (one, up), (two, also) = pair
            neighbours[one].append((two, up == also))
            neighbours[two].append((one, up == also))
    turned = np.zeros(len(faces), int)  # 1 as it is, -1 turned
    for seed in range(len(faces)):
        if turned[seed]:
            continue
        turned[seed], part, ahead = 1, [seed], [seed]
        while ahead:
            here = ahead.pop()
            for other, opposed in neighbours[here]:
                if not turned[other]:
                    turned[other] = -turned[here] if opposed else turned[here]
                    part.append(other)
                    ahead.append(other)
        if turned[part].sum() < 0:
            turned[part] *= -1
    return np.where(turned[:, None] < 0, faces[:, ::-1], faces)
