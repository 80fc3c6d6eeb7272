"""The polygon fit on real strips: voltages from networks that the fit's closed forms did not make.

A row per unit and noise (`studies.estimation`): share of right vertex counts; RMS vertex error, in mm and over the
Cramer-Rao bound's; share of true vertices in their 95 % regions, and of the two ends alone; share of scans that are not
"ok". First with the
noise known to the fit, then estimated by it. Then with its bound used: error, scans that no polygon fits within the
bound, scans not "ok", and silent ones ("ok", but a vertex too many or few, or one outside of its guaranteed region).
Run: python benchmarks/estimation.py [--contacts 40] [--draws 2] [--units lambda all ...] [--signatures kh kl]
"""

from __future__ import annotations

import argparse

from studies.estimation import NOISES, UNITS, Outcome, outcome, real_contacts
from tacstrip.contact.noise import Noise

SEED = 1


def _fit(o: Outcome) -> str:
    return f"{o.right:.2f} | {o.rms_mm:.2f} | {o.of_bound:.2f} | {o.inside:.2f} ({o.ends:.2f}) | {o.doubtful:.2f}"


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--contacts", type=int, default=40)
    options.add_argument("--draws", type=int, default=2, help="of the noise, per contact")
    options.add_argument("--units", nargs="+", choices=list(UNITS), default=list(UNITS))
    options.add_argument("--signatures", nargs="+", choices=("kh", "kl"), default=["kh", "kl"])
    chosen = options.parse_args()
    wide = any(UNITS[unit][0] in ("width", "all") for unit in chosen.units)
    contacts = real_contacts(chosen.contacts, SEED, wide)
    fit = "right | mm | / bound | in 95 % (ends) | doubtful"
    print(
        f"| unit | noise | known: {fit} | unknown: {fit} | bounded: mm | / bound | empty | doubtful | silent |"
    )
    print("| --- " * 17 + "|")
    for unit in chosen.units:
        for half_width in NOISES:
            known, unknown, bounded = (
                outcome(contacts, unit, Noise(positional=half_width), *how, chosen.signatures, chosen.draws)
                for how in ((True, False), (False, False), (True, True))
            )
            b = bounded
            left = f"{b.rms_mm:.2f} | {b.of_bound:.2f} | {b.empty:.2f} | {b.doubtful:.2f} | {b.silent:.2f}"
            row = f"{unit} | {100.0 * half_width:g} % | {_fit(known)} | {_fit(unknown)} | {left}"
            print(f"| {row} |", flush=True)


if __name__ == "__main__":
    main()
