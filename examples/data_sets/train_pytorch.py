"""Train a small network in PyTorch to find the centre of what touches, from a data set on disk and without tacstrip.

    tacstrip generate study.toml --out data
    python examples/data_sets/train_pytorch.py data [--epochs 20]

Prints the median error of the centre on the validation split, beside that of the mean centre.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from scans import inputs_and_targets
from torch import nn
from torch.utils.data import DataLoader, TensorDataset


def tensors(folder: Path, split: str) -> tuple[torch.Tensor, torch.Tensor]:
    """Return inputs (scans, channels, strips) and centres (scans, 2) [mm]."""
    inputs, targets = inputs_and_targets(folder, split)
    return torch.from_numpy(inputs), torch.from_numpy(targets)


def main() -> None:
    """Train, and print what the network reaches."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("folder", type=Path)
    options.add_argument("--epochs", type=int, default=20)
    given = options.parse_args()
    torch.manual_seed(0)
    inputs, targets = tensors(given.folder, "train")
    middle, spread = targets.mean(dim=0), targets.std(dim=0)
    network = nn.Sequential(
        nn.Flatten(),
        nn.Linear(inputs[0].numel(), 128),
        nn.GELU(),
        nn.Linear(128, 64),
        nn.GELU(),
        nn.Linear(64, 2),
    )
    descent = torch.optim.Adam(network.parameters(), lr=1e-3)
    batches = DataLoader(TensorDataset(inputs, (targets - middle) / spread), batch_size=128, shuffle=True)
    for _ in range(given.epochs):
        for x, y in batches:
            descent.zero_grad()
            nn.functional.mse_loss(network(x), y).backward()
            descent.step()
    inputs, targets = tensors(given.folder, "validation")
    with torch.no_grad():
        off = torch.linalg.norm(network(inputs) * spread + middle - targets, dim=1)
    plain = torch.linalg.norm(middle - targets, dim=1)
    print(f"centre off by {off.median():.2f} mm (median); the mean centre by {plain.median():.2f} mm")


if __name__ == "__main__":
    main()
