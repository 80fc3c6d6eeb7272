"""Objects over time while their scans come one by one: one rigid outline each, known better with every scan."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.problem import FLOOR
from tacstrip.errors import OptionError, ReadingError
from tacstrip.reconstruction.implausible import doubted, scale_hint
from tacstrip.reconstruction.noise_covariance import Averaging, fit_sigma
from tacstrip.reconstruction.on_surface import refuse_stretched
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import left_out, left_out_wholly
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.episodes import followed
from tacstrip.tracking.live_contact import LiveContact, LiveTrack, Stream
from tacstrip.tracking.rigid.fixed_lag import LAG


class LiveTracks:
    """Fuses the scans of each object into one rigid outline, as `track` does, while they come.

    The last scans keep free poses; what those before told of the corners is a normal distribution. The shape itself is
    searched for when a contact has moved, again after twice as many scans until 200 have told of it, and when readings
    are no more explained; each scan between takes some .3 ms.

    Parameters
    ----------
    sensor
        That makes the scans, of a construction with a closed form.
    noise
        Of the readings; None: the spec's `[noise]`, and without one estimated from what the first fit leaves over.
    lag
        How many scans keep free poses.
    executor
        Runs the searches; None: every search runs at once, in `update`.

    Attributes
    ----------
    searching
        Number of objects that the last scan's tracks lack because the search for their first shape has not ended.

    Raises
    ------
    SignatureError
        The construction has no closed form.
    OptionError
        The lag is no number of scans.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape, noise = ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)]), ts.Noise(positional=0.002)
    >>> live, known = ts.LiveTracks(sensor, noise), []
    >>> for i in range(40):
    ...     placed = shape.turned(0.03 * i).placed(45 + 0.3 * i, 50)
    ...     for one in live.update(ts.simulate(sensor, placed, noise, rng=i, time_s=0.01 * i)):
    ...         known.append(one.corner_deviation_mm)
    >>> known[0] > 2 * known[-1]
    True
    """

    @takes(sensor=Sensor, noise=Noise)
    def __init__(
        self, sensor: Sensor, noise: Noise | None = None, lag: int = LAG, executor: Executor | None = None
    ) -> None:
        check_closed_form(sensor.kind, "track")
        refuse_stretched(sensor, "LiveTracks")
        if not isinstance(lag, int) or lag < 1:
            raise OptionError(f"lag = {lag}: must be a number of scans, 1 or more")
        self.sensor = sensor
        self.noise = noise = sensor.noise if noise is None else noise
        distribution = "normal" if noise is None or not noise.independent else noise.distribution
        self._stream = Stream(sensor, (), distribution, lag, executor, None)
        self._own: tuple[str, ...] = ()  # signatures of its scans
        self._silent = left_out_wholly(sensor)
        self._number = 0
        self._contacts: list[LiveContact] = []
        self.searching = 0

    @property
    def searches(self) -> int:
        """Number of searches so far."""
        return self._stream.searches

    def update(self, scan: Scan, wait: bool = False) -> tuple[LiveTrack, ...]:
        """Return the objects of the next scan of which a shape is known or was, in the order of their strips.

        Parameters
        ----------
        scan
            The next scan.
        wait
            Whether to wait for searches that the executor has not ended: for the last scan.

        Raises
        ------
        ReadingError, SignatureError
            The scan is not of this sensor, or has other signatures than those before.
        """
        stream, own = self._stream, scan.signatures
        scan = scan.checked(self.sensor)
        if not self._own:
            out = left_out(self.sensor)
            self._own = own
            stream.names = tuple(name for name in own if name not in out or not out[name].all()) or own
            if self.noise is not None:
                stream.sigma = max(fit_sigma(self.noise, self.sensor, Averaging.of(scan)), FLOOR)
        if own != self._own:
            raise ReadingError(
                f"the scan has {' and '.join(own)}, and those before {' and '.join(self._own)}: give scans alike"
            )
        self._number += 1
        k = np.stack([scan.reading(name) for name in stream.names])
        touched = np.asarray(np.isfinite(k).any(axis=0))
        before = {id(c.episode): c for c in self._contacts}
        seen = followed([c.episode for c in self._contacts], self._number, touched, self._silent)
        self._contacts = [before.get(id(e)) or LiveContact(e, stream) for e in seen]
        for lifted in before.values():
            if lifted in self._contacts:
                continue
            stream.remember(lifted.known_shape)
        joint = [c for c in self._contacts if c.episode.joint]
        found = [self._step(contact, joint, k, scan.time_s, wait) for contact in self._contacts]
        pairs = zip(found, self._contacts, strict=True)
        self.searching = sum(one is None and contact.searching for one, contact in pairs)
        shown = [one for one in found if one is not None]
        outlines = [one.placed for one in shown if np.isfinite(one.pose[0])]
        if not (scale := scale_hint([scan], outlines, self.sensor)):
            return tuple(shown)
        judged = [(one, doubted(one.status, one.advice, scale)) for one in shown]
        return tuple(replace(one, status=status, advice=advice) for one, (status, advice) in judged)

    def _step(
        self, contact: LiveContact, joint: list[LiveContact], k: FloatArray, time_s: float, wait: bool
    ) -> LiveTrack | None:
        """Give a contact its part of the scan; `joint` share strips with others."""
        where = contact.episode
        if where.joint:
            where.joint.clear()
            others = [c for c in joint if c is not contact and c.episode.last == where.last]
            return contact.shared(k, time_s, others, wait)
        where.scans.clear()
        where.runs[:] = where.runs[-1:]
        own = np.full(k.shape, np.nan)
        own[:, where.last] = k[:, where.last]
        return contact.step(own, time_s, wait)
