"""Draw how a board, two multiplexers and a ten-strip sensor are joined: docs/guide/build.md, docs/guide/rp2040.md.

Run: make pictures (writes docs/pictures/wiring_*.png).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from tacstrip.plot.theme import COLOURS, SENSOR, STRIP, new_axes, save

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
STRIPS = 10
ADDRESS, SUPPLY, GROUND, ENABLE = "#7a3e9d", "#9c1c1c", "#333333", "#b8860b"
LINES = ("#e07b39", COLOURS["kl"])
X0, PITCH = 48.0, 4.6  # of the strips
PULL_X, ENABLE_X = 25.0, 28.5
TOP, BOTTOM = 46.0, 20.0  # ends of the strips
PIN = {  # height of its wire
    "line 0": 62.0, "pull 0": 58.0, "supply": 50.5, "address": 36.0, "enable": 31.0, "ground": 15.5, "pull 1": 8.0,
    "line 1": 4.0,
}  # fmt: skip


class Board(NamedTuple):
    """A board: its name, how its pins are called, its supply."""

    name: str
    pins: dict[str, str]
    supply: str
    name_y: float  # where there is room for it


UNO = Board(
    "Arduino\nUno",
    dict(zip(PIN, ("A0", "D6", "5V", "D2-D5", "D8", "GND", "D7", "A1"), strict=True)),
    "5 V",
    33.5,
)
PICO = Board(
    "Raspberry Pi\nPico\n(RP2040)",
    dict(zip(PIN, ("GP26", "GP10", "3V3", "GP2-GP5", "GP6", "AGND", "GP11", "GP27"), strict=True)),
    "3.3 V",
    23.0,
)


def wire(axes: Axes, points: Iterable[tuple[float, float]], colour: str, width: float = 1.2) -> None:
    """Draw a wire through points, with a dot where it ends."""
    x, y = zip(*points, strict=True)
    axes.plot(x, y, color=colour, lw=width, solid_capstyle="round", solid_joinstyle="round", zorder=2)


def dot(axes: Axes, x: float, y: float, colour: str) -> None:
    """Draw a joint."""
    axes.plot([x], [y], "o", color=colour, ms=4, zorder=4)


def box(
    axes: Axes, x: float, y: float, width: float, height: float, text: str, colour: str = "white"
) -> None:
    """Draw a part with its name."""
    axes.add_patch(Rectangle((x, y), width, height, facecolor=colour, edgecolor="#222222", lw=1.0, zorder=3))
    axes.text(x + width / 2, y + height / 2, text, ha="center", va="center", zorder=5, fontsize=8)


def multiplexer(axes: Axes, y: float, inner_y: float, inputs: dict[str, float], supply: str) -> None:
    """Draw a multiplexer across the strips: its channels on the side of `inner_y`, its control pins at the left."""
    box(axes, X0 - 7, y, STRIPS * PITCH + 4, 10, "CD74HC4067\n16-way multiplexer")
    for i in range(STRIPS):
        inner = y if inner_y < y else y + 10
        away = 1.4 if inner == y else -1.4
        axes.text(x_of(i), inner + away, f"C{i}", ha="center", va="center", fontsize=6, zorder=5)
    for name, at in inputs.items():
        axes.text(X0 - 6.5, at, name, va="center", fontsize=6.5, zorder=5)

    feed(axes, y, supply)


def feed(axes: Axes, y: float, supply: str) -> None:
    """Draw a multiplexer's supply at its right, with its capacitor."""
    right, x = X0 - 7 + STRIPS * PITCH + 4, 97.0
    for name, at, rail, colour in (("VCC", y + 6.6, supply, SUPPLY), ("GND", y + 3.4, "GND", GROUND)):
        axes.text(right - 0.4, at, name, ha="right", va="center", fontsize=6, zorder=5)
        wire(axes, [(right, at), (x + 1.2, at)], colour)
        axes.text(x + 1.5, at, rail, va="center", fontsize=6, color=colour)
        dot(axes, x, at, colour)
        plate = y + (5.4 if colour == SUPPLY else 4.6)
        wire(axes, [(x, at), (x, plate)], colour)
        wire(axes, [(x - 1.0, plate), (x + 1.0, plate)], "#222222", 2.0)
    axes.text(x + 1.5, y + 5, "100 nF", va="center", fontsize=6)


def resistor(axes: Axes, x: float, y: float, ohm: str, colour: str, left: bool = False) -> None:
    """Draw a resistor on an upright wire, with its value."""
    axes.add_patch(Rectangle((x - 0.8, y - 1.2), 1.6, 2.4, facecolor="white", edgecolor=colour, zorder=3))
    axes.text(
        x + (-1.6 if left else 1.2), y, ohm, va="center", ha="right" if left else "left", fontsize=7, zorder=5
    )


def x_of(strip: int) -> float:
    """Return where a strip's centre line is."""
    return X0 + strip * PITCH


def pull(axes: Axes, line_y: float, pin_y: float, colour: str) -> None:
    """Draw the weak pull: 100 kohm between a line and its pin."""
    x, low, high = PULL_X, *sorted((line_y, pin_y))
    wire(axes, [(16, pin_y), (x, pin_y), (x, line_y)], colour)
    resistor(axes, x, (low + high) / 2, "100 kΩ", colour, left=True)
    dot(axes, x, line_y, colour)


def wiring(switched: bool, board: Board = UNO) -> Figure:
    """Return the diagram for strips that lie on Vref and ground for good, or that are switched one by one (CRS-M)."""
    figure, axes = new_axes(10.0, 6.8)
    axes.set_axis_off()
    axes.set_xlim(0, 104)
    axes.set_ylim(-1, 71)
    box(axes, 2, 1, 14, 65, "", "#e7eef5")
    axes.text(9, board.name_y, board.name, ha="center", va="center", zorder=5, fontsize=8)
    for pin, y in PIN.items():
        if not (switched and pin in ("line 1", "pull 1")):
            axes.text(15.3, y, board.pins[pin], ha="right", va="center", fontsize=7.5, zorder=5)
    common = (
        {"upper": PIN["line 0"], "lower": PIN["line 1"]} if not switched else {"upper": 62.0, "lower": 4.0}
    )
    upper = {"S0-S3": 57.0, "EN": 59.5, "SIG": common["upper"]}
    lower = {"S0-S3": 11.0, "EN": 7.5, "SIG": common["lower"]}
    multiplexer(axes, 55, 0, upper, board.supply)
    multiplexer(axes, 2, 66, lower, board.supply)
    for pin, name, x, colour, width in (
        ("address", "S0-S3", 36, ADDRESS, 3.0),
        ("enable", "EN", 34, ENABLE, 1.2),
    ):
        wire(axes, [(16, PIN[pin]), (x, PIN[pin])], colour, width)
        wire(
            axes,
            [(X0 - 7, upper[name]), (x, upper[name]), (x, lower[name]), (X0 - 7, lower[name])],
            colour,
            width,
        )
        dot(axes, x, PIN[pin], colour)
    wire(axes, [(ENABLE_X, PIN["enable"]), (ENABLE_X, PIN["supply"])], ENABLE)
    resistor(axes, ENABLE_X, 45.5, "10 kΩ", ENABLE)
    dot(axes, ENABLE_X, PIN["enable"], ENABLE)
    dot(axes, ENABLE_X, PIN["supply"], SUPPLY)
    (draw_switched if switched else draw_common)(axes, common)
    return figure


def draw_common(axes: Axes, common: dict[str, float]) -> None:
    """Draw CRS-CRS: energised strips on Vref and ground, sensing strips to the multiplexers."""
    for end, pin, pull_pin, colour in (
        ("upper", "line 0", "pull 0", LINES[0]),
        ("lower", "line 1", "pull 1", LINES[1]),
    ):
        wire(axes, [(16, PIN[pin]), (X0 - 7, common[end])], colour)
        pull(axes, PIN[pin], PIN[pull_pin], colour)
    axes.text(27, PIN["line 0"] + 1, "k_h", color=LINES[0], fontsize=8)
    axes.text(27, PIN["line 1"] - 2.2, "k_l", color=LINES[1], fontsize=8)
    right = x_of(STRIPS - 1) + 2.2
    wire(axes, [(16, PIN["supply"]), (right, PIN["supply"])], SUPPLY, 1.8)
    wire(axes, [(16, PIN["ground"]), (right, PIN["ground"])], GROUND, 1.8)
    for i in range(STRIPS):
        x = x_of(i)
        axes.add_patch(
            Rectangle((x, BOTTOM), 3.0, TOP - BOTTOM, facecolor=SENSOR, edgecolor="#999999", zorder=2)
        )
        axes.add_patch(
            Rectangle(
                (x - 1.0, BOTTOM), 2.0, TOP - BOTTOM, facecolor="#8d8778", edgecolor="#555555", zorder=3
            )
        )
        wire(axes, [(x + 2.2, TOP), (x + 2.2, PIN["supply"])], SUPPLY)
        wire(axes, [(x + 2.2, BOTTOM), (x + 2.2, PIN["ground"])], GROUND)
        dot(axes, x + 2.2, PIN["supply"], SUPPLY)
        dot(axes, x + 2.2, PIN["ground"], GROUND)
        wire(axes, [(x, TOP), (x, 55)], LINES[0])
        wire(axes, [(x, BOTTOM), (x, 12)], LINES[1])
    axes.text(17, 22, "dark: sensing strips\nlight: energised strips,\nface to face with them", fontsize=7)
    axes.set_title("CRS-CRS, ten strips, double measurement")


def draw_switched(axes: Axes, common: dict[str, float]) -> None:
    """Draw CRS-M: one multiplexer gives Vref, the other ground, and the sheet is read."""
    wire(
        axes,
        [(16, PIN["supply"]), (30, PIN["supply"]), (30, common["upper"]), (X0 - 7, common["upper"])],
        SUPPLY,
        1.8,
    )
    wire(
        axes,
        [(16, PIN["ground"]), (30, PIN["ground"]), (30, common["lower"]), (X0 - 7, common["lower"])],
        GROUND,
        1.8,
    )
    resistor(axes, 30, 56, "100 Ω", SUPPLY)
    left, right = X0 - 3.0, x_of(STRIPS - 1) + 3.0
    axes.add_patch(
        Rectangle(
            (left, BOTTOM + 3),
            right - left,
            TOP - BOTTOM - 6,
            facecolor="#d5dde3",
            edgecolor="#778899",
            zorder=1,
        )
    )
    axes.text(17, 22, "grey: metal sheet\nunder the strips", fontsize=7)
    colour = COLOURS["k"]
    wire(
        axes,
        [
            (16, PIN["line 0"]),
            (PULL_X, PIN["line 0"]),
            (PULL_X, 68),
            (right + 2, 68),
            (right + 2, 33),
            (right, 33),
        ],
        colour,
    )
    pull(axes, PIN["line 0"], PIN["pull 0"], colour)
    axes.text(27, 68.8, "k", color=colour, fontsize=8)
    for i in range(STRIPS):
        x = x_of(i)
        axes.add_patch(
            Rectangle((x - 1.2, BOTTOM), 2.4, TOP - BOTTOM, facecolor=STRIP, edgecolor="#777777", zorder=2)
        )
        wire(axes, [(x, TOP), (x, 55)], SUPPLY)
        wire(axes, [(x, BOTTOM), (x, 12)], GROUND)
    axes.set_title("CRS-M, ten strips, each switched alone")


def with_plug(figure: Figure) -> Figure:
    """Add to the Pico's diagram the way to the plug, and the sensor cut across its strips."""
    (axes,) = figure.axes
    figure.set_size_inches(14.0, 9.2)
    axes.set_xlim(-50, 104)
    axes.set_ylim(-30, 71)
    box(axes, -28, 29, 18, 24, "USB-serial   \nadapter   \nof 3.3 V   ", "#eef5e7")
    box(axes, -49, 34, 13, 14, "computer\n\ntacstrip live", "#f4f4f4")
    wire(axes, [(-36, 41), (-28, 41)], "#222222", 5.0)
    axes.text(-32, 43, "USB plug", ha="center", fontsize=7)
    signal = "#1f6f8b"
    for y, pin, name, colour in (
        (47.0, "GP0", "RXD", signal),
        (41.0, "GP1", "TXD", signal),
        (35.0, "GND", "GND", GROUND),
    ):
        wire(axes, [(-10, y), (2, y)], colour)
        axes.text(-10.5, y, name, ha="right", va="center", fontsize=6.5, zorder=5)
        axes.text(2.6, y, pin, va="center", fontsize=7, zorder=5)
    reference, supply = PIN["supply"] + 6, PIN["supply"] + 2
    wire(axes, [(2, reference), (-2, reference), (-2, supply), (2, supply)], SUPPLY)
    for y, pin in ((reference, "ADC_VREF"), (supply, "3V3"), (11.0, "USB")):
        axes.text(2.6, y, pin, va="center", fontsize=6.5, zorder=5)
    box(axes, -28, 6, 18, 10, "USB power\n(and flashing)", "#f4f4f4")
    wire(axes, [(-10, 11), (2, 11)], "#222222", 3.0)
    draw_section(axes)
    axes.set_title("From the cross-section to the plug: CRS-CRS, ten strips, Raspberry Pi Pico")
    return figure


def draw_section(axes: Axes) -> None:
    """Draw the sensor cut across its strips, each under its own in the diagram, with an object that presses three."""
    left, right = X0 - 4.0, x_of(STRIPS - 1) + 5.5
    first, last, dip = 3, 5, 3.0  # strips under the object, and by how much it presses them down
    edges = (x_of(first) - PITCH / 2, x_of(last) + PITCH / 2)
    cover = [(left, -18.0), (edges[0] - 1, -18.0), (edges[0], -18.0 - dip), (edges[1], -18.0 - dip),
             (edges[1] + 1, -18.0), (right, -18.0)]  # fmt: skip
    upper = [(x, y + 1.4) for x, y in reversed(cover)]
    axes.add_patch(Polygon([*cover, *upper], facecolor="#e9e2d0", edgecolor="#555555", zorder=2))
    axes.add_patch(
        Rectangle((left, -29), right - left, 3, facecolor="#c9c2b5", edgecolor="#555555", zorder=2)
    )
    for i in range(STRIPS):
        x, down = x_of(i), dip if first <= i <= last else 0.0
        for y, colour in ((-25.9, SENSOR), (-20.5 - down, "#8d8778")):
            axes.add_patch(Rectangle((x - 1.4, y), 2.8, 2.2, facecolor=colour, edgecolor="#555555", zorder=3))
        if i < STRIPS - 1 and (i + 1 < first or i > last):
            axes.plot([x + PITCH / 2], [-22.1], "o", color="#6aa84f", ms=3.5, zorder=3)
        axes.plot([x, x], [-16.2, 1.5], color="#bbbbbb", lw=0.6, ls=":", zorder=1)
    width = edges[1] - edges[0]
    axes.add_patch(Rectangle((edges[0], -19.6), width, 7, facecolor="#d9a066", edgecolor="#7a4a1a", zorder=4))
    axes.text(edges[0] + width / 2, -15.5, "object", ha="center", va="center", fontsize=7, zorder=5)
    names = (
        (-17.3, "cover"),
        (-19.4, "sensing strips, 1 mm: both ends to the multiplexers"),
        (-22.1, "dots or mesh, 0.3 to 1 mm: apart until something presses"),
        (-24.8, "energised strips, 1 mm: upper ends to 3V3, lower to AGND"),
        (-27.5, "stiff plate"),
    )
    for y, name in names:
        axes.text(left - 1.5, y, name, ha="right", va="center", fontsize=7)
    axes.text(right + 1.5, -22, "cut across\nthe strips,\nnot to scale", fontsize=7, va="center")


def main() -> None:
    """Write all three."""
    for name, figure in (
        ("wiring_crs_crs", wiring(False)),
        ("wiring_crs_m", wiring(True)),
        ("wiring_pico", with_plug(wiring(False, PICO))),
    ):
        print(save(figure, PICTURES / f"{name}.png", dpi=90))


if __name__ == "__main__":
    main()
