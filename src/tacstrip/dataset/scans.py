"""Many scans as arrays, with what touched them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, TypeAlias, overload

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, IntArray, extent
from tacstrip.contact.shape import Contact
from tacstrip.dataset.shapes import KINDS
from tacstrip.errors import ReadingError, SignatureError
from tacstrip.files import replacing, why_unreadable
from tacstrip.notebook import Drawn, SvgPath, signature_paths
from tacstrip.scan import Scan, Signatures
from tacstrip.sensor.constructions import SIGNATURES

Floats: TypeAlias = npt.NDArray[Any]  # float32 or float64
Which: TypeAlias = slice | IntArray | BoolArray | Sequence[int]

_ROUND = 256  # corners of a contact that stands for an ellipse
_FORMAT = 1
_DRAWN = 6  # scans in a notebook's picture


@dataclass(frozen=True, eq=False)
class Labels:
    """What touched in each scan; the places of objects and corners that are not there hold NaN, or 0 in `kind`.

    Attributes
    ----------
    scene
        Number of the scene (scans,): scans of one scene show the same objects, moving.
    kind
        (scans, objects): 0 none, 1 polygon, 2 circle, 3 ellipse, 4 line, 5 points.
    corners
        How many corners, or points (scans, objects).
    pose
        x, y [mm] and angle [rad] (scans, objects, 3): of drawn objects the centre of their ellipse and the direction of
        its long axis; of given contacts the centroid, and NaN.
    axes
        Half the long and the short axis (scans, objects, 2) [mm] of drawn objects' ellipses; NaN of given contacts.
    vertices
        Corners (scans, objects, most, 2) [mm], counter-clockwise.
    """

    scene: IntArray
    kind: npt.NDArray[np.int8]
    corners: IntArray
    pose: Floats
    axes: Floats
    vertices: Floats

    def __getitem__(self, which: Which) -> Labels:
        """Return some of the scans' labels."""
        return Labels(**{name: values[which] for name, values in vars(self).items()})

    def contact(self, scan: int) -> Contact:
        """Return what touched in a scan, an ellipse as a polygon of 256 corners.

        Raises
        ------
        ReadingError
            Nothing did.
        """
        contacts = []
        for o in np.flatnonzero(self.kind[scan]):
            kind, corners = KINDS[self.kind[scan, o]], self.vertices[scan, o, : self.corners[scan, o]]
            if kind in ("circle", "ellipse"):
                (x, y, turn), (a, b) = self.pose[scan, o].astype(float), self.axes[scan, o].astype(float)
                along = 2.0 * np.pi * np.arange(_ROUND) / _ROUND
                p, q = a * np.cos(along), b * np.sin(along)
                c, s = np.cos(turn), np.sin(turn)
                corners = np.stack([x + p * c - q * s, y + p * s + q * c], axis=1)
            make = {"line": Contact.line, "points": Contact.points}.get(kind, Contact.polygon)
            contacts.append(make(corners))
        if not contacts:
            raise ReadingError(f"nothing touches in scan {scan}")
        return Contact(tuple(s for contact in contacts for s in contact.shapes))


@dataclass(frozen=True, eq=False)
class Scans(Signatures, Drawn):
    """Readings of many scans over Vref, an array (scans, strips) per signature; NaN where nothing touches.

    `scans[3]` is a `Scan`, `scans[10:20]` and `scans[mask]` are `Scans`; iterating gives a `Scan` after the other.

    Attributes
    ----------
    kh, kl, k
        Readings (scans, strips), float32 or float64; None where the construction has no such signature.
    time_s
        When (scans,) [s]; 0 where it was not given.
    l, u
        Lower and upper ends of the contact (scans, strips) [mm], where they are known.
    labels
        What touched, where it is known.

    Raises
    ------
    ReadingError
        No signature, arrays of different shapes, or not (scans, strips).

    Examples
    --------
    >>> import numpy as np
    >>> scans = Scans(k=np.array([[0.4, np.nan], [0.5, 0.6]]))
    >>> len(scans), scans[0].touched.tolist(), scans[1:].k.tolist()
    (2, [True, False], [[0.5, 0.6]])
    """

    kh: Floats | None = None
    kl: Floats | None = None
    k: Floats | None = None
    time_s: npt.NDArray[np.float64] | None = None
    l: Floats | None = None
    u: Floats | None = None
    labels: Labels | None = None

    def __post_init__(self) -> None:
        names = self.signatures
        if not names:
            raise ReadingError("scans need at least one signature: kh, kl or k")
        for name in (*names, *[end for end in ("l", "u") if getattr(self, end) is not None]):
            values = np.asarray(getattr(self, name))
            if values.dtype not in (np.float32, np.float64):
                values = values.astype(float)
            object.__setattr__(self, name, values)
            if values.ndim != 2 or values.shape != self[names[0]].shape:
                shape = " and ".join(str(s) for s in dict.fromkeys((self[names[0]].shape, values.shape)))
                raise ReadingError(
                    f"{name} needs readings (scans, strips), all arrays alike, not of shape {shape}"
                )
        times = np.zeros(len(self)) if self.time_s is None else np.asarray(self.time_s, dtype=float)
        if times.shape != (len(self),):
            raise ReadingError(
                f"time_s needs one time for each of {len(self)} scans, not shape {times.shape}"
            )
        object.__setattr__(self, "time_s", times)

    def __repr__(self) -> str:
        ranges = ", ".join(f"{name} {extent(self[name])}" for name in self.signatures)
        labels = ", labelled" if self.labels is not None else ""
        return f"<{len(self)} scans of {self[self.signatures[0]].shape[1]} strips: {ranges}{labels}>"

    def _paths(self) -> list[SvgPath]:
        shown = np.unique(np.linspace(0, len(self) - 1, _DRAWN).astype(int)).tolist() if len(self) else []
        return signature_paths([{name: self[name][i] for name in self.signatures} for i in shown])

    def __len__(self) -> int:
        return len(self[self.signatures[0]])

    @overload
    def __getitem__(self, which: str) -> Floats: ...
    @overload
    def __getitem__(self, which: int | np.integer[Any]) -> Scan: ...
    @overload
    def __getitem__(self, which: Which) -> Scans: ...
    def __getitem__(self, which: str | int | np.integer[Any] | Which) -> Floats | Scan | Scans:
        """Return one signature's readings (scans, strips), one scan, or some of the scans.

        Raises
        ------
        SignatureError
            The scans do not have that signature.
        """
        if isinstance(which, str):
            values: Floats | None = getattr(self, which) if which in SIGNATURES else None
            if values is None:
                raise SignatureError(f"the scans have no {which!r}; they have: {', '.join(self.signatures)}")
            return values
        assert self.time_s is not None
        if isinstance(which, int | np.integer):
            return Scan(**{n: self[n][which] for n in self.signatures}, time_s=float(self.time_s[which]))
        parts = {name: getattr(self, name) for name in (*self.signatures, "time_s", "l", "u", "labels")}
        return replace(self, **{name: None if v is None else v[which] for name, v in parts.items()})

    def __iter__(self) -> Iterator[Scan]:
        return (self[i] for i in range(len(self)))

    @classmethod
    def of(cls, scans: Sequence[Scan]) -> Self:
        """Put scans of one sensor together; `list(...)` takes them apart again.

        Raises
        ------
        ReadingError
            There is none, they have different signatures or numbers of strips, or one is a mean or has electrodes.
        """
        if not scans:
            raise ReadingError("there are no scans to put together")
        names, strips = scans[0].signatures, len(scans[0].touched)
        for i, scan in enumerate(scans):
            if scan.signatures != names or len(scan.touched) != strips:
                raise ReadingError(f"scan {i} has other signatures or another number of strips than scan 0")
            if scan.averaged > 1 or scan.electrodes is not None:
                what = "a mean of several" if scan.averaged > 1 else "of all electrodes"
                raise ReadingError(f"scan {i} is {what}, which Scans cannot hold: keep the scans in a list")
        readings: dict[str, Any] = {name: np.stack([scan[name] for scan in scans]) for name in names}
        return cls(**readings, time_s=np.array([scan.time_s for scan in scans]))

    def contact(self, scan: int) -> Contact:
        """Return what touched in a scan; errors as of `Labels.contact`, and where there are no labels."""
        if self.labels is None:
            raise ReadingError("the scans have no labels that say what touched")
        return self.labels.contact(scan)

    def save(self, path: str | Path) -> None:
        """Write all of it as a NumPy archive (.npz), whole or not at all."""
        arrays = {name: getattr(self, name) for name in (*self.signatures, "time_s", "l", "u")}
        if self.labels is not None:
            arrays |= {f"label_{name}": values for name, values in vars(self.labels).items()}
        with replacing(path) as part, part.open("wb") as file:
            np.savez(file, format=_FORMAT, **{n: v for n, v in arrays.items() if v is not None})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote.

        Raises
        ------
        ReadingError
            The file is missing, damaged, or is none of scans.
        """
        if why := why_unreadable(path):
            raise ReadingError(f"{path}: {why}")
        try:
            with np.load(path) as archive:
                found = {name: archive[name] for name in archive.files}
            if found.pop("format") != _FORMAT:
                raise ReadingError(f"{path}: written by a newer tacstrip")
            labels = {name[6:]: found.pop(name) for name in list(found) if name.startswith("label_")}
            return cls(**found, labels=Labels(**labels) if labels else None)
        except FileNotFoundError:
            raise ReadingError(f"{path}: no such file") from None
        except ReadingError:
            raise
        except Exception as error:  # whatever a damaged archive does to its reader
            raise ReadingError(f"{path}: no archive of scans, or a damaged one ({error})") from None
