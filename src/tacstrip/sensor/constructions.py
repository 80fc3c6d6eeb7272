"""The table of constructions (thesis, chapter 3) and of the signatures they measure.

Everything that differs between constructions is a column here; no other file compares the name.
"""

from __future__ import annotations

from dataclasses import dataclass

from tacstrip.errors import OptionError, SignatureError, SpecError, one_of


@dataclass(frozen=True)
class Signature:
    """One measured quantity of a strip: a voltage over Vref."""

    name: str
    symbol: str  # as the thesis writes it, for pictures
    volt_column: str  # in a readings file
    code_column: str
    at_upper_end: bool  # the sensing strip is read at the contact's upper end, not its lower


SIGNATURES: dict[str, Signature] = {
    s.name: s
    for s in (
        Signature("kh", "k_h", "v_h", "code_h", at_upper_end=True),
        Signature("kl", "k_l", "v_l", "code_l", at_upper_end=False),
        Signature("k", "k", "v_out", "code", at_upper_end=False),
    )
}


@dataclass(frozen=True, kw_only=True)
class Construction:
    """What a construction measures, is made of and needs."""

    name: str
    title: str
    signatures: tuple[str, ...]
    sensing_ratio: float | None  # resistivity of the second layer over the strip's; None: the spec says
    keys: frozenset[str] = frozenset()  # keys of the spec that only some constructions have
    required: frozenset[str] = frozenset()
    cylindrical: bool = False
    # All strips lie on Vref and ground for good; else their ends are switched in turn.
    common_supply: bool = False
    # A strip's readings follow from its own l and u; else from the network of all strips.
    closed_form: bool = True
    wires: tuple[int, int] = (2, 2)  # connectors for all signatures: per strip, and once
    models: str  # equations or section of the thesis

    def connectors(self, strips: int) -> int:
        """Count the connectors that all signatures need (3.1, 3.2)."""
        return self.wires[0] * strips + self.wires[1]


CONSTRUCTIONS: dict[str, Construction] = {
    c.name: c
    for c in (
        Construction(
            name="crs-crs",
            title="conductive-rubber strips over conductive-rubber strips",
            signatures=("kh", "kl"),
            sensing_ratio=None,
            keys=frozenset({"resistivity_ratio"}),
            common_supply=True,
            models="(3.1)-(3.6)",
        ),
        Construction(
            name="crs-m",
            title="conductive-rubber strips over a metal sheet",
            signatures=("k",),
            sensing_ratio=0.0,
            models="(3.7)-(3.8)",
        ),
        Construction(
            name="crs-crp",
            title="conductive-rubber strips over a sheet of more resistive rubber",
            signatures=("kh", "kl"),
            sensing_ratio=None,
            keys=frozenset({"resistivity_ratio"}),
            required=frozenset({"contact_lambda_mm"}),
            closed_form=False,
            # Both ends of a strip, and an electrode on either edge of the sheet in line with it.
            wires=(4, 0),
            models="3.3",
        ),
        Construction(
            name="cyl-crs-m",
            title="conductive-rubber strips over metal, round a tube",
            signatures=("k",),
            sensing_ratio=0.0,
            keys=frozenset({"radius_mm"}),
            required=frozenset({"radius_mm"}),
            cylindrical=True,
            models="(3.7)-(3.8)",
        ),
    )
}


def construction(name: str) -> Construction:
    """Look a construction up.

    Raises
    ------
    SpecError
        There is no such construction; the message lists those that exist.
    """
    try:
        return CONSTRUCTIONS[name]
    except (KeyError, TypeError):
        raise SpecError(one_of("construction", name, CONSTRUCTIONS)) from None


def check_closed_form(kind: Construction, what: str) -> None:
    """Refuse `what`, the start of the message, for a construction without a closed form.

    Raises
    ------
    OptionError
        Its strips' readings follow only from the network of all of them.
    """
    if not kind.closed_form:
        raise OptionError(
            f"{what} needs a closed form, and a {kind.name} sensor has none (3.3): its strips shift each other's "
            'readings. Simulate with the model "network" and reconstruct with the method "profile": they take all '
            "strips together"
        )


def check_signature(kind: Construction, signature: str) -> Signature:
    """Return the signature's row if this construction measures it.

    Raises
    ------
    SignatureError
        The signature does not exist, or this construction does not measure it.
    """
    if signature not in SIGNATURES:
        raise SignatureError(one_of("signature", signature, SIGNATURES))
    if signature not in kind.signatures:
        have = ", ".join(kind.signatures)
        raise SignatureError(f"a {kind.name} sensor has no signature {signature!r}; it has: {have}")
    return SIGNATURES[signature]
