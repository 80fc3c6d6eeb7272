"""Draw how an Arduino Uno, two multiplexers and a ten-strip sensor are joined, for docs/guide/build.md.

Run: make pictures (writes docs/pictures/wiring_*.png).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tacstrip.plot.style import COLOURS, SENSOR, STRIP, new_axes, save

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
STRIPS = 10
ADDRESS, SUPPLY, GROUND, ENABLE = "#7a3e9d", "#9c1c1c", "#333333", "#b8860b"
LINES = ("#e07b39", COLOURS["kl"])
X0, PITCH = 48.0, 4.6  # of the strips
PULL_X, ENABLE_X = 25.0, 28.5
TOP, BOTTOM = 46.0, 20.0  # ends of the strips
UNO = {  # pin: height of its wire
    "A0": 62.0, "D6": 58.0, "5V": 50.5, "D2-D5": 36.0, "D8": 31.0, "GND": 15.5, "D7": 8.0, "A1": 4.0,
}  # fmt: skip


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


def multiplexer(axes: Axes, y: float, inner_y: float, inputs: dict[str, float]) -> None:
    """Draw a multiplexer across the strips: its channels on the side of `inner_y`, its control pins at the left."""
    box(axes, X0 - 7, y, STRIPS * PITCH + 4, 10, "CD74HC4067\n16-way multiplexer")
    for i in range(STRIPS):
        inner = y if inner_y < y else y + 10
        away = 1.4 if inner == y else -1.4
        axes.text(x_of(i), inner + away, f"C{i}", ha="center", va="center", fontsize=6, zorder=5)
    for name, at in inputs.items():
        axes.text(X0 - 6.5, at, name, va="center", fontsize=6.5, zorder=5)

    feed(axes, y)


def feed(axes: Axes, y: float) -> None:
    """Draw a multiplexer's supply at its right, with its capacitor."""
    right, x = X0 - 7 + STRIPS * PITCH + 4, 97.0
    for name, at, rail, colour in (("VCC", y + 6.6, "5 V", SUPPLY), ("GND", y + 3.4, "GND", GROUND)):
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


def wiring(switched: bool) -> Figure:
    """Return the diagram for strips that lie on Vref and ground for good, or that are switched one by one (CRS-M)."""
    figure, axes = new_axes(10.0, 6.8)
    axes.set_axis_off()
    axes.set_xlim(0, 104)
    axes.set_ylim(-1, 71)
    box(axes, 2, 1, 14, 65, "Arduino\nUno", "#e7eef5")
    for pin, y in UNO.items():
        if not (switched and pin in ("A1", "D7")):
            axes.text(15.3, y, pin, ha="right", va="center", fontsize=7.5, zorder=5)
    common = {"upper": UNO["A0"], "lower": UNO["A1"]} if not switched else {"upper": 62.0, "lower": 4.0}
    upper = {"S0-S3": 57.0, "EN": 59.5, "SIG": common["upper"]}
    lower = {"S0-S3": 11.0, "EN": 7.5, "SIG": common["lower"]}
    multiplexer(axes, 55, 0, upper)
    multiplexer(axes, 2, 66, lower)
    for pin, name, x, colour, width in (("D2-D5", "S0-S3", 36, ADDRESS, 3.0), ("D8", "EN", 34, ENABLE, 1.2)):
        wire(axes, [(16, UNO[pin]), (x, UNO[pin])], colour, width)
        wire(
            axes,
            [(X0 - 7, upper[name]), (x, upper[name]), (x, lower[name]), (X0 - 7, lower[name])],
            colour,
            width,
        )
        dot(axes, x, UNO[pin], colour)
    wire(axes, [(ENABLE_X, UNO["D8"]), (ENABLE_X, UNO["5V"])], ENABLE)
    resistor(axes, ENABLE_X, 45.5, "10 kΩ", ENABLE)
    dot(axes, ENABLE_X, UNO["D8"], ENABLE)
    dot(axes, ENABLE_X, UNO["5V"], SUPPLY)
    (draw_switched if switched else draw_common)(axes, common)
    return figure


def draw_common(axes: Axes, common: dict[str, float]) -> None:
    """Draw CRS-CRS: energised strips on Vref and ground, sensing strips to the multiplexers."""
    for end, pin, pull_pin, colour in (("upper", "A0", "D6", LINES[0]), ("lower", "A1", "D7", LINES[1])):
        wire(axes, [(16, UNO[pin]), (X0 - 7, common[end])], colour)
        pull(axes, UNO[pin], UNO[pull_pin], colour)
    axes.text(27, UNO["A0"] + 1, "k_h", color=LINES[0], fontsize=8)
    axes.text(27, UNO["A1"] - 2.2, "k_l", color=LINES[1], fontsize=8)
    right = x_of(STRIPS - 1) + 2.2
    wire(axes, [(16, UNO["5V"]), (right, UNO["5V"])], SUPPLY, 1.8)
    wire(axes, [(16, UNO["GND"]), (right, UNO["GND"])], GROUND, 1.8)
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
        wire(axes, [(x + 2.2, TOP), (x + 2.2, UNO["5V"])], SUPPLY)
        wire(axes, [(x + 2.2, BOTTOM), (x + 2.2, UNO["GND"])], GROUND)
        dot(axes, x + 2.2, UNO["5V"], SUPPLY)
        dot(axes, x + 2.2, UNO["GND"], GROUND)
        wire(axes, [(x, TOP), (x, 55)], LINES[0])
        wire(axes, [(x, BOTTOM), (x, 12)], LINES[1])
    axes.text(17, 22, "dark: sensing strips\nlight: energised strips,\nface to face with them", fontsize=7)
    axes.set_title("CRS-CRS, ten strips, double measurement")


def draw_switched(axes: Axes, common: dict[str, float]) -> None:
    """Draw CRS-M: one multiplexer gives Vref, the other ground, and the sheet is read."""
    wire(
        axes,
        [(16, UNO["5V"]), (30, UNO["5V"]), (30, common["upper"]), (X0 - 7, common["upper"])],
        SUPPLY,
        1.8,
    )
    wire(
        axes,
        [(16, UNO["GND"]), (30, UNO["GND"]), (30, common["lower"]), (X0 - 7, common["lower"])],
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
        [(16, UNO["A0"]), (PULL_X, UNO["A0"]), (PULL_X, 68), (right + 2, 68), (right + 2, 33), (right, 33)],
        colour,
    )
    pull(axes, UNO["A0"], UNO["D6"], colour)
    axes.text(27, 68.8, "k", color=colour, fontsize=8)
    for i in range(STRIPS):
        x = x_of(i)
        axes.add_patch(
            Rectangle((x - 1.2, BOTTOM), 2.4, TOP - BOTTOM, facecolor=STRIP, edgecolor="#777777", zorder=2)
        )
        wire(axes, [(x, TOP), (x, 55)], SUPPLY)
        wire(axes, [(x, BOTTOM), (x, 12)], GROUND)
    axes.set_title("CRS-M, ten strips, each switched alone")


def main() -> None:
    """Write both."""
    for name, switched in (("wiring_crs_crs", False), ("wiring_crs_m", True)):
        print(save(wiring(switched), PICTURES / f"{name}.png", dpi=90))


if __name__ == "__main__":
    main()
