"""Pictures of sensors, contacts, scans, results and what else there is: Axes in, Axes out, without a display.

Each function takes axes of yours as `ax`, or makes a figure of its own (`ax.figure`), and returns the axes. None
touches pyplot or Matplotlib's settings: `plot.style("print")` holds as long as its `with` block. In a notebook
`plot.scan(scan, sensor).figure` as a cell's last line shows the picture; in a script write it to a file, or give axes
of pyplot and call its `show`.

Examples
--------
>>> import tacstrip as ts
>>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
>>> scan = ts.simulate(sensor, ts.Contact.polygon([(30, 40), (60, 35), (70, 60), (40, 70)]))
>>> ax = ts.plot.result(ts.reconstruct(scan, sensor), sensor)
>>> ax.figure.savefig("shape.svg")

The names that this package gives are listed in `__init__.pyi`, once, and loaded when first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
