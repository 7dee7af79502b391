"""Gradient of the press's rollout by the reference: reverse mode beside central differences, and the figure of it."""

import time
from pathlib import Path

import identify_scene as press
import numpy as np

SIZES = (4, 12, 40, 120, 400)
"""Numbers of the reference trajectory, four joints of as many hat functions as it takes."""


def gradient(whole, nominal: np.ndarray, measured: np.ndarray) -> dict:
    """Reverse mode through the rollout against central differences, by numbers of the reference."""
    import jax
    import jax.numpy as jnp

    data, times = jnp.asarray(measured), press.sample_times()

    def cost(reference):
        return 0.5 * jnp.sum(((data - whole(nominal, reference, None)) / press.deviations()[None]) ** 2)

    forward, backward = jax.jit(cost), jax.jit(jax.value_and_grad(cost))
    base = jnp.asarray(press.reference(times))
    begin = time.perf_counter()
    jax.block_until_ready(forward(base + 1e-6 * np.zeros(base.shape)) - forward(base))
    rows: dict = {"compile forward s": time.perf_counter() - begin}
    begin = time.perf_counter()
    jax.block_until_ready(backward(base))
    rows["compile reverse s"] = time.perf_counter() - begin
    rows["parameters"] = {}
    for size in SIZES:
        knots = size // 4
        hats = np.maximum(0.0, 1.0 - np.abs(times[:, None] / press.DURATION * knots - np.arange(knots) - 0.5))
        moved = [hats[:, [i]] * np.eye(4)[None, j] for i in range(knots) for j in range(4)]
        spent = []
        for _ in range(5):
            begin = time.perf_counter()
            slope = jax.block_until_ready(backward(base)[1])
            exact = (hats.T @ np.asarray(slope)).ravel()
            spent.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        near = [float(forward(base + 1e-6 * d) - forward(base - 1e-6 * d)) / 2e-6 for d in moved]
        differences = time.perf_counter() - begin
        error = float(np.max(np.abs(exact - near)) / np.max(np.abs(exact)))
        rows["parameters"][str(size)] = {"reverse s": min(spent), "differences s": differences, "disagreement": error}
        rows["parameters"][str(size)]["ratio"] = differences / min(spent)
    return rows


def drawn(gradient: dict, path: Path) -> None:
    """Time over the number of parameters."""
    import matplotlib.pyplot as plt

    found = gradient["parameters"]
    sizes = [int(size) for size in found]
    figure, axes = plt.subplots(figsize=(5.5, 3.8), layout="constrained")
    for name, label in (("reverse s", "reverse mode, exact"), ("differences s", "central differences")):
        axes.loglog(sizes, [row[name] for row in found.values()], "o-", label=label)
    axes.set(xlabel="numbers of the reference trajectory", ylabel="one gradient, s")
    axes.set_title("Gradient through a rollout of 200 steps")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)
