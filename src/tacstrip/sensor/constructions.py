"""The table of constructions (thesis, chapter 3) and of the signatures they measure.

Everything that differs between constructions is a column here; no other file compares the name.
"""

from __future__ import annotations

from dataclasses import dataclass

from tacstrip.errors import SignatureError, SpecError, one_of


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


@dataclass(frozen=True)
class Construction:
    """What a construction measures, is made of and needs."""

    name: str
    title: str
    signatures: tuple[str, ...]
    sensing_ratio: float | None  # resistivity of the second layer over the strip's; None: the spec says
    keys: frozenset[str]  # keys of the spec that only some constructions have
    required: frozenset[str]
    cylindrical: bool
    common_supply: bool  # all strips lie on Vref and ground for good; else their ends are switched in turn
    models: str  # equations of the thesis

    def connectors(self, strips: int) -> int:
        """Count the connectors for all signatures: 2n + 2 for every construction so far (3.1, 3.2)."""
        return 2 * strips + 2


CONSTRUCTIONS: dict[str, Construction] = {
    c.name: c
    for c in (
        Construction(
            name="crs-crs",
            title="conductive-rubber strips over conductive-rubber strips",
            signatures=("kh", "kl"),
            sensing_ratio=None,
            keys=frozenset({"resistivity_ratio"}),
            required=frozenset(),
            cylindrical=False,
            common_supply=True,
            models="(3.1)-(3.6)",
        ),
        Construction(
            name="crs-m",
            title="conductive-rubber strips over a metal sheet",
            signatures=("k",),
            sensing_ratio=0.0,
            keys=frozenset(),
            required=frozenset(),
            cylindrical=False,
            common_supply=False,
            models="(3.7)-(3.8)",
        ),
        Construction(
            name="cyl-crs-m",
            title="conductive-rubber strips over metal, round a tube",
            signatures=("k",),
            sensing_ratio=0.0,
            keys=frozenset({"radius_mm"}),
            required=frozenset({"radius_mm"}),
            cylindrical=True,
            common_supply=False,
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
