"""Train a small network in JAX to find the centre of what touches, from a data set on disk and without tacstrip.

    tacstrip generate study.toml --out data
    python examples/data_sets/train_jax.py data [--epochs 20]

Prints the median error of the centre on the validation split, beside that of the mean centre.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scans import inputs_and_targets

Weights = list[tuple[Any, Any]]


def network(weights: Weights, inputs: Any) -> Any:
    """Return targets of inputs (scans, channels, strips), by two hidden layers."""
    values = inputs.reshape(len(inputs), -1)
    for matrix, shift in weights[:-1]:
        values = jax.nn.gelu(values @ matrix + shift)
    return values @ weights[-1][0] + weights[-1][1]


def beginning(sizes: list[int], seed: int = 0) -> Weights:
    """Return random weights of layers of these sizes."""
    keys = jax.random.split(jax.random.key(seed), len(sizes) - 1)
    return [
        (jax.random.normal(key, (a, b)) * (2.0 / a) ** 0.5, jnp.zeros(b))
        for key, a, b in zip(keys, sizes, sizes[1:], strict=False)
    ]


def main() -> None:
    """Train, and print what the network reaches."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("folder", type=Path)
    options.add_argument("--epochs", type=int, default=20)
    given = options.parse_args()
    inputs, targets = inputs_and_targets(given.folder, "train")
    middle, spread = targets.mean(axis=0), targets.std(axis=0)
    wanted = (targets - middle) / spread
    weights = beginning([inputs[0].size, 128, 64, 2])
    means = jax.tree.map(jnp.zeros_like, weights), jax.tree.map(jnp.zeros_like, weights)

    def one_step(weights: Weights, means: Any, count: Any, x: Any, y: Any) -> tuple[Weights, Any]:
        slope = jax.grad(lambda w: jnp.mean((network(w, x) - y) ** 2))(weights)
        first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, means[0], slope)
        second = jax.tree.map(lambda m, g: 0.999 * m + 0.001 * g * g, means[1], slope)
        rate = 1e-3 * jnp.sqrt(1.0 - 0.999**count) / (1.0 - 0.9**count)  # Adam
        moved = jax.tree.map(lambda w, m, v: w - rate * m / (jnp.sqrt(v) + 1e-8), weights, first, second)
        return moved, (first, second)

    step = jax.jit(one_step)

    order, count = np.random.default_rng(0), 0
    for _ in range(given.epochs):
        shuffled = order.permutation(len(inputs))
        for part in np.array_split(shuffled, max(len(inputs) // 128, 1)):
            count += 1
            weights, means = step(weights, means, count, inputs[part], wanted[part])
    inputs, targets = inputs_and_targets(given.folder, "validation")
    off = np.linalg.norm(np.asarray(network(weights, inputs)) * spread + middle - targets, axis=1)
    plain = np.linalg.norm(middle - targets, axis=1)
    print(f"centre off by {np.median(off):.2f} mm (median); the mean centre by {np.median(plain):.2f} mm")


if __name__ == "__main__":
    main()
