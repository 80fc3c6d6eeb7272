"""`tacstrip demo`."""

from __future__ import annotations

from pathlib import Path

import click

from tacstrip.cli import options, own_folder
from tacstrip.errors import OptionError
from tacstrip.files import replaceable
from tacstrip.io.geojson import write_geojson
from tacstrip.reconstruction.result import Reconstruction


@click.command()
@options.file("--out", default="demo", help="Folder to write to.")
@options.figure_format("Of the picture.")
def command(out: Path, kind: str) -> None:
    """Reconstruct a rectangle from packaged volts of the ten-strip prototype, before and after calibration.

    The volts are synthetic: the published geometry, a tilted 5 x 3.5 cm rectangle, the printed offsets and
    the printed residual errors. Writes a picture and the reconstructed shape.

    Example: tacstrip demo --out demo
    """
    from tacstrip.plot.theme import ENDINGS, save
    from tacstrip.thesis.demo import FIT, picture, run, table  # late: --help does without it

    own_folder(out, *(f"demo{ending}" for ending in ENDINGS))
    if not replaceable(out / "shape.geojson"):  # others draw a demo.png, too
        raise OptionError(f"{out / 'shape.geojson'} is not of this verb; name a new or an empty folder")
    demo = run()
    click.echo(
        "Synthetic readings of the thesis' CRS-CRS prototype (10 strips, 6.5 x 32.5 cm, 5 x 3.5 cm object).\n"
        "Polygon fit: the default of `tacstrip reconstruct`. P.R. and V.R.: the thesis' Profile and Vertex\n"
        "Reconstruction; transitions given: the true ones. Of the polygon fit `ok` promises an overlap (IoU) of\n"
        "0.8 or more in 95 of 100 cases; of these two it says that there is a solution.\n\n"
        f"{table(demo)}"
    )
    best = next(t for t in demo.trials if (t.readings, t.method) == ("after", FIT))
    out.mkdir(parents=True, exist_ok=True)
    file = save(picture(demo), out / f"demo.{kind}")  # first: by it the folder is known as this verb's
    write_geojson(out / "shape.geojson", [Reconstruction("polygon", (best.recovered,))])
    click.echo(f"\n{file}: the picture\n{out / 'shape.geojson'}: the fitted polygon after calibration, in mm")
